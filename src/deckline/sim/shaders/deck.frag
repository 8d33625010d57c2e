#version 330
#include sky.glsl
uniform sampler2D paint_map;
uniform vec4 paint_area;     // x0, y0, length, width of the texture in deck metres
uniform mat4 world_from_ship4;
uniform vec3 eye;
uniform vec3 sun_rgb;
uniform vec3 ambient_rgb;
uniform float wet;
in vec3 at;
in vec3 facing;
in vec3 albedo;
out vec4 rgba;

void main() {
    vec4 paint = texture(paint_map, (at.xy - paint_area.xy) / paint_area.zw);
    vec3 light = ambient_rgb * 0.9 + sun_rgb * max(sun.z, 0.0) * 0.8;
    vec3 d = normalize((world_from_ship4 * vec4(at, 1.0)).xyz - eye);
    float grazing = pow(1.0 - max(d.z, 0.0), 5.0);
    float puddle = texture(noise_map, at.xy * 0.013 + offset).g;
    vec3 rgb = paint.rgb * light;
    rgb = mix(rgb, sky_base(reflect(d, vec3(0.0, 0.0, -1.0))), wet * grazing * (0.4 + 0.6 * puddle));
    rgba = vec4(rgb, 1.0);
}
