#version 330
uniform mat4 light_from_ship;
in vec3 position;
void main() { gl_Position = vec4((light_from_ship * vec4(position, 1.0)).xyz * 2.0 - 1.0, 1.0); }
