#version 330
#include light.glsl
uniform mat4 clip_from_ship;
uniform vec4 depth_row;
uniform vec4 lens;           // fx, fy, cx, cy
uniform float lamps;         // brightness of a lamp of strength 1
in vec3 position;
in vec3 colour;
in float strength;
out vec3 glow;
const float BULB_M = 0.5;    // how large a lamp looks close by
const float FLOOR_PX = 2.5;
const float FULL_M = 400.0;  // beyond, a lamp is dimmer the farther it is
void main() {
    float axial_m = max(dot(depth_row, vec4(position, 1.0)), 1.0);
    glow = reflectance(colour) * strength * lamps * min(1.0, FULL_M / axial_m);
    gl_Position = clip_from_ship * vec4(position, 1.0);
    gl_Position.z -= 2e-4 * gl_Position.w;  // in front of the plate it is let into
    gl_PointSize = max(FLOOR_PX, BULB_M * lens.x / axial_m);
}
