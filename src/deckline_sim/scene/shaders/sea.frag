#version 330
#include light.glsl
#include sky.glsl
#include backdrop.glsl
uniform sampler2D wave_map;  // slope down and across the wind, height, rank of the foam; tiles
uniform vec2 wind;           // unit vector downwind
uniform vec4 tiles_m;        // sizes of the wave map's copies: waves, crossing waves, ripples, swell
uniform vec4 drift_m;        // how far each has travelled
uniform float wave_slope;    // root mean square
uniform float ripple_slope;
uniform float swell_slope;
uniform float roughness;     // root mean square slope of what is too small to be drawn
uniform float gusts;
uniform vec3 sea_rgb;        // what the water sends back of the light
uniform vec2 mirror;         // exponent and factor of its mean Fresnel reflectance
uniform float sea_sheen;     // how much of the sky that it mirrors is seen
uniform float glint;
uniform float whitecaps;     // part of the sea under foam
uniform float streaks;
uniform vec3 foam_rgb;
uniform vec4 ship;           // stern x, y, cos and sin of the heading; world
uniform vec4 wake;           // half width at the stern, spread, length, opacity
uniform vec3 wake_rgb;
uniform float wake_hard;     // 0 soft, 1 cut out
uniform float hull_m;
const float SLOPE_UNIT = 8.0;  // the map spans +-4 root mean squares
const float WAVE_TEXELS = 512.0;
const mat2 SWELL = mat2(0.643, 0.766, -0.766, 0.643);
const float KELVIN = 0.354;    // tangent of Kelvin's 19.47 degrees

vec4 waves(vec2 q, mat2 turn, float tile_m, float moved_m, float print) {
    vec2 at = (turn * q - vec2(moved_m, 0.0)) / tile_m;
    vec4 map = textureLod(wave_map, at, print + log2(WAVE_TEXELS / tile_m));
    return vec4((map.xy - 0.5) * SLOPE_UNIT * turn, map.zw);
}

float noise(vec2 at, float print, float per_m) {
    return textureLod(noise_map, at + offset, print + log2(NOISE_TEXELS * per_m)).r;
}

// Foam (x) and how far the water is stirred up (y), and the slope of the ship's own waves (zw).
vec4 wake_at(vec2 p, float print) {
    vec2 v = p - ship.xy;
    vec2 s = vec2(v.x * ship.z + v.y * ship.w, v.y * ship.z - v.x * ship.w);
    float aft = hull_m - s.x, side = abs(s.y);
    float arm = 8.0 + KELVIN * aft;
    if (aft < -25.0 || aft > 9.0 * wake.z + hull_m || side > arm + 60.0) return vec4(0.0);
    float astern = max(-s.x, 0.0);
    float ragged = noise(s * vec2(0.0027, 0.0083), print, 0.0083) - 0.5;
    float fine = noise(s.yx * vec2(0.043, 0.017), print, 0.043) - 0.5;
    float soft = mix(0.45, 0.03, wake_hard);
    float half_m = wake.x + wake.y * astern + 26.0 * ragged * min(astern / 90.0 + 0.1, 1.0) + 5.0 * fine;
    float inside = smoothstep(half_m * (1.0 + 0.3 * soft) + 0.5, half_m * (1.0 - soft) - 0.5, side);
    float along = s.x < 6.0 ? exp(-astern / wake.z) : 0.0;
    float beside_m = wake.x + 5.0 + 0.4 * wake.y * aft + 14.0 * ragged + 10.0 * fine;
    float beside = smoothstep(beside_m, beside_m * (1.0 - soft), side) * smoothstep(-0.5 * wake.z, 0.0, s.x + 20.0 * ragged)
        * smoothstep(-4.0, 0.1 * hull_m, aft);
    float torn = mix(0.45 + 1.5 * (fine + 0.4 * ragged + 0.15), 0.85 + 0.5 * fine, wake_hard);
    float foam = max(inside * along, 0.85 * beside) * clamp(torn, 0.0, 1.0);
    float crest = (side - arm) / (6.0 + 0.02 * aft);
    float roll = exp(-crest * crest) * exp(-aft / (1.5 * wake.z)) * sin(2.0 * crest + 0.06 * aft + 30.0 * ragged);
    float ridge = smoothstep(0.75, 1.0, roll + 1.6 * fine) * 0.5 * step(aft, 0.7 * hull_m);
    vec2 outward = vec2(-0.35, sign(s.y)) * roll * (0.6 + 2.0 * fine) * 0.1;
    outward = vec2(outward.x * ship.z - outward.y * ship.w, outward.x * ship.w + outward.y * ship.z);
    return vec4(max(foam, ridge), max(inside * exp(-0.4 * astern / wake.z), beside), outward) * wake.w;
}

float glitter(vec3 d, vec2 slope, float spread) {
    vec3 h = normalize(-sun - d);
    vec2 miss = h.xy / h.z - slope;
    float variance = spread * spread;
    float density = exp(-dot(miss, miss) / (2.0 * variance)) / (2.0 * variance);  // Cox and Munk, times pi
    float off = 1.0 - max(dot(h, -d), 0.0), off2 = off * off, fresnel = 0.02 + 0.98 * off2 * off2 * off;
    float upright = h.z * h.z;
    return min(fresnel * density / (4.0 * max(d.z, 0.03) * upright * upright), 1.5);
}

vec3 surface(vec3 d, float t, vec2 p, float print) {
    vec2 q = vec2(dot(p, wind), wind.x * p.y - wind.y * p.x);
    float gust = 1.0 + gusts * (noise(q * vec2(0.0011, 0.0023), print, 0.0023) - 0.5);
    vec4 first = waves(q, mat2(0.966, 0.259, -0.259, 0.966), tiles_m.x, drift_m.x, print);
    vec4 second = waves(q, mat2(0.819, -0.574, 0.574, 0.819), tiles_m.y, drift_m.y, print);
    vec4 third = waves(q, mat2(0.940, 0.342, -0.342, 0.940), tiles_m.z, drift_m.z, print);
    vec2 slope = (wave_slope * 0.707 * (first.xy + second.xy) + ripple_slope * third.xy) * gust;
    if (swell_slope > 0.0) slope += swell_slope * waves(q, SWELL, tiles_m.w, drift_m.w, max(print, log2(tiles_m.w / 50.0))).xy;
    vec4 stirred = wake.w > 0.0 ? wake_at(p, print) : vec4(0.0);
    slope = slope * (1.0 - 0.6 * stirred.y) + stirred.zw;
    slope = slope.x * wind + slope.y * vec2(-wind.y, wind.x);
    vec3 n = normalize(vec3(-slope, -1.0));
    float spread = roughness * gust;
    float fresnel = pow(1.0 - max(dot(n, -d), 0.0), mirror.x) * mirror.y;
    vec3 mirrored = reflect(d, n);
    mirrored.z = -abs(mirrored.z) - 1.3 * spread;
    vec3 light = ambient_rgb + sun_rgb * max(sun.z, 0.0);
    float crest = 0.5 * (first.z + second.z) - 0.5;
    vec3 rgb = sea_rgb * light * (1.0 + 1.5 * crest * min(wave_slope * 8.0, 1.0));
    rgb = mix(rgb, sky_base(mirrored), (0.02 + 0.98 * fresnel) * sea_sheen);
    if (glint > 0.0) rgb += glint * glitter(d, slope, spread) * sun_rgb;
    float foam = 0.0;
    if (whitecaps > 0.0) {
        float share = min(whitecaps * gust * gust, 0.5), torn = 0.25 * (third.w - 0.5);
        foam = smoothstep(-0.02, 0.03, 0.5 * (first.w + second.w) + torn * share + share - 1.0);
        float far = smoothstep(-8.0, -4.3, print - log2(tiles_m.x));
        foam = mix(foam, share, far) * 0.85;
        float rows = noise(q * vec2(0.004, 0.11), print, 0.05);
        foam = max(foam, streaks * smoothstep(0.62, 0.85, rows) * (0.5 + first.w));
    }
    rgb = mix(rgb, foam_rgb * light, foam);
    rgb = mix(rgb, wake_rgb * light * mix(0.3, 1.0, wake_hard), 0.45 * min(stirred.y, 1.0));
    return mix(rgb, wake_rgb * light, min(stirred.x, 1.0));
}
