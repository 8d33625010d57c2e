#version 330
#include light.glsl
uniform mat4 clip_from_ship;
uniform mat4 light_from_ship;  // shadow map coordinates, 0..1
uniform vec4 depth_row;        // depth along the optical axis = dot(depth_row, (ship point, 1))
uniform vec4 down_row;         // world z = dot(down_row, (ship point, 1))
uniform float clip_z;          // nothing is drawn below this world z: the water closes over it
in vec3 position;
in vec3 normal;
in vec3 colour;
out vec3 at;
out vec3 facing;
out vec3 albedo;
out vec3 spot;
out float axial_m;
const float LIFT_M = 0.12;     // off the surface, so that none shadows itself
void main() {
    at = position;
    facing = normal;
    albedo = reflectance(colour);
    spot = (light_from_ship * vec4(position + LIFT_M * normal, 1.0)).xyz;
    axial_m = dot(depth_row, vec4(position, 1.0));
    gl_ClipDistance[0] = clip_z - dot(down_row, vec4(position, 1.0));
    gl_Position = clip_from_ship * vec4(position, 1.0);
}
