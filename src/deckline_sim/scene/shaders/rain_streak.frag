#version 330
uniform vec3 light;          // that a falling drop throws into the camera
in vec2 at;
flat in vec4 what;
out vec4 rgba;
void main() { rgba = vec4(light, what.x * (1.0 - at.x * at.x) * smoothstep(1.0, 0.7, abs(at.y))); }
