// Light on surfaces, in linear units: 1 is what a white horizontal surface in full daylight sends. Shared by all solids.
uniform vec3 sun;          // from the sun (at night the moon) to the ground
uniform vec3 sun_rgb;      // on a surface that faces it
uniform vec3 ambient_rgb;  // of the sky, on a horizontal surface
uniform vec3 flood_rgb;    // of the ship's own lamps
uniform float shadow;      // how dark shadows are, 0..1
uniform sampler2DShadow shadow_map;
const float BOUNCE = 0.3;  // what water and deck send up, of what the sky sends down

// Of a colour as a display shows it: IEC 61966-2-1 (sRGB), the curve by which the card reads the deck's paint.
vec3 reflectance(vec3 shown) {
    return mix(pow((max(shown, 0.0) + 0.055) / 1.055, vec3(2.4)), shown / 12.92, lessThan(shown, vec3(0.04045)));
}

float sunlit(vec3 spot) { return 1.0 - shadow * (1.0 - texture(shadow_map, spot)); }

vec3 irradiance(vec3 n, float lit) {
    float up = 0.5 - 0.5 * n.z;
    return ambient_rgb * mix(BOUNCE, 1.0, up) + sun_rgb * (lit * max(dot(n, -sun), 0.0)) + flood_rgb * (0.4 + 0.6 * up);
}
