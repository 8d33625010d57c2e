#version 330
uniform vec2 size;           // of the picture, px
in vec2 pixel;
in vec2 within;              // -1..1 across the quad
in vec4 detail;              // streak: opacity; drop: middle, px, radius, px, softness of its rim
out vec2 at;
flat out vec4 what;
void main() {
    at = within;
    what = detail;
    gl_Position = vec4(2.0 * (pixel + 0.5) / size - 1.0, 0.0, 1.0);
}
