// The ray of a pixel to a sea or ground plane, and the sky above it. Needs light.glsl and sky.glsl.
uniform vec4 lens;           // fx, fy, cx, cy
uniform mat3 world_from_optical;
uniform vec3 eye;
uniform float sea_z;
uniform float fade_m;        // distance where the surface melts into the horizon
out vec4 rgba;

vec3 surface(vec3 d, float t, vec2 p, float print);  // d unit, t and p in metres, print: log2 of a pixel's metres

void main() {
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 d = normalize(world_from_optical * vec3((pixel - lens.zw) / lens.xy, 1.0));
    float slant = fwidth(d.z);
    float above = smoothstep(0.5 * slant, -0.5 * slant, d.z - 1e-4);
    vec3 rgb = vec3(0.0);
    if (above < 1.0) {
        float down = max(d.z, 1e-4);
        float t = (sea_z - eye.z) / down;
        // Between the footprint's width and its length: all detail would alias, no detail would leave it bare.
        float print = log2(t / lens.x) - 0.6 * log2(down);
        rgb += (1.0 - above) * mix(horizon_rgb, surface(d, t, eye.xy + d.xy * t, print), exp(-t / fade_m));
    }
    if (above > 0.0) rgb += above * sky(d, 1.0 / lens.x);
    rgba = vec4(rgb, 1.0);
}
