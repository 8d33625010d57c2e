#version 330
uniform sampler2D radiance;  // with mipmaps
uniform float zoom;          // how much of the picture a drop shows, turned upside down, in its own radii
in vec2 at;
flat in vec4 what;           // middle, px, radius, px, softness of its rim
out vec4 rgba;
void main() {
    vec2 bent = at * (1.0 + 0.12 * sin(3.0 * atan(at.y, at.x) + what.x) + 0.1 * sin(2.0 * atan(at.y, at.x) + what.y));
    float r = length(bent);
    if (r > 1.0) discard;
    vec2 size = vec2(textureSize(radiance, 0));
    vec2 seen = what.xy - bent * what.z * zoom * (0.4 + 0.6 * r * r);
    float lod = log2(max(what.z * 0.35, 1.0));
    vec3 inside = textureLod(radiance, (seen + 0.5) / size, lod).rgb;
    float rim = smoothstep(1.0, 0.75, r);
    rgba = vec4(inside * (0.65 + 0.35 * rim), smoothstep(1.0, 1.0 - what.w, r));
}
