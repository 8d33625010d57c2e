#version 330
#include light.glsl
#include sky.glsl
#include backdrop.glsl
uniform vec3 ground_rgb;     // display colours
uniform vec3 field_rgb;
uniform float field_m;       // size of a field
uniform vec4 ship;           // stern x, y, cos and sin of the runway's heading; world
const float FIELD_FAR = 0.6; // where fields melt together, in footprints per field

vec3 random3(vec2 cell) {
    vec3 v = fract(vec3(cell.xyx) * vec3(0.1031, 0.1030, 0.0973));
    v += dot(v, v.yxz + 33.33);
    return fract((v.xxy + v.yzz) * v.zyx);
}

vec3 surface(vec3 d, float t, vec2 p, float print) {
    float footprint_m = exp2(print);
    vec2 v = p - ship.xy;
    vec2 q = vec2(v.x * ship.z + v.y * ship.w, v.y * ship.z - v.x * ship.w);
    float broad = textureLod(noise_map, q * 0.0017 + offset, print + log2(NOISE_TEXELS * 0.0017)).r;
    float fine = textureLod(noise_map, q * 0.031 + offset, print + log2(NOISE_TEXELS * 0.031)).g;
    vec2 bent = mat2(0.8, 0.6, -0.6, 0.8) * q + 60.0 * (broad - 0.5);
    float row = floor(bent.y / field_m);
    vec2 cell = vec2(floor(bent.x / (field_m * 1.7) + 0.37 * row), row);
    vec3 dice = random3(cell);
    float plain = smoothstep(80.0, 140.0, abs(q.y)) * (1.0 - smoothstep(0.2, FIELD_FAR, footprint_m / field_m));
    vec3 shown = mix(ground_rgb, field_rgb, clamp(0.5 + plain * (dice.x - 0.5) * 2.4 + 1.2 * (broad - 0.5), 0.0, 1.0));
    shown *= 1.0 + plain * 0.3 * (dice.y - 0.5);
    float furrows = plain * step(0.6, dice.z) * sin(bent.y * 1.3) * exp(-footprint_m);
    vec3 rgb = reflectance(shown * (0.82 + 0.36 * fine + 0.06 * furrows));
    return rgb * (ambient_rgb + sun_rgb * max(sun.z, 0.0));
}
