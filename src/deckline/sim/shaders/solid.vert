#version 330
uniform mat4 clip_from_ship;
uniform vec4 depth_row;      // depth along the optical axis = dot(depth_row, (ship point, 1))
in vec3 position;
in vec3 normal;
in vec3 colour;
out vec3 at;
out vec3 facing;
out vec3 albedo;
out float axial_m;
void main() {
    at = position;
    facing = normal;
    albedo = colour;
    axial_m = dot(depth_row, vec4(position, 1.0));
    gl_Position = clip_from_ship * vec4(position, 1.0);
}
