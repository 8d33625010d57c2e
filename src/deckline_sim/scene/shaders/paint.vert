#version 330
uniform vec4 paint_area;
in vec2 position;
in vec4 colour;
in float worn;
out vec2 at;
out vec4 paint;
out float wears;
void main() {
    at = position;
    paint = colour;
    wears = worn;
    gl_Position = vec4(2.0 * (position - paint_area.xy) / paint_area.zw - 1.0, 0.0, 1.0);
}
