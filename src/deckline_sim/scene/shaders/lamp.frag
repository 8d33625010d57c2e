#version 330
in vec3 glow;
out vec4 rgba;
void main() {
    vec2 off = 2.0 * gl_PointCoord - 1.0;
    float fall = max(1.0 - dot(off, off), 0.0);
    rgba = vec4(glow * fall * fall, 0.0);
}
