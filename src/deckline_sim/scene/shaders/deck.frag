#version 330
#include light.glsl
#include sky.glsl
uniform sampler2D paint_map;
uniform vec4 paint_area;     // x0, y0, length, width of the texture in deck metres
uniform mat4 world_from_ship4;
uniform vec3 eye;
uniform float wet;
in vec3 at;
in vec3 spot;
out vec4 rgba;

void main() {
    vec3 paint = texture(paint_map, (at.xy - paint_area.xy) / paint_area.zw).rgb;  // the texture unit makes it linear
    vec3 n = -world_from_ship4[2].xyz;
    float lit = sunlit(spot);
    vec3 rgb = paint * irradiance(n, lit);
    if (wet > 0.0) {
        vec3 d = normalize((world_from_ship4 * vec4(at, 1.0)).xyz - eye);
        float grazing = 1.0 - max(-dot(d, n), 0.0);
        float puddle = texture(noise_map, at.xy * 0.013 + offset).g;
        float mirror = wet * grazing * grazing * grazing * grazing * grazing * (0.25 + 1.2 * max(puddle - 0.35, 0.0));
        rgb = mix(rgb, sky_base(reflect(d, n)), min(mirror, 0.8));
    }
    rgba = vec4(rgb, 1.0);
}
