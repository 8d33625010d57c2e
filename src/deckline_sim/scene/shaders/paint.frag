#version 330
uniform sampler2D noise_map;
uniform vec2 noise_offset;
uniform float grain;
uniform float wear;
in vec2 at;
in vec4 paint;
in float wears;
out vec4 rgba;

void main() {
    vec2 p = at + noise_offset;
    float coarse = texture(noise_map, p * 0.011).r;
    float fine = texture(noise_map, p.yx * 0.17).g;
    float rough = 0.6 * coarse + 0.4 * fine - 0.5;
    float gone = smoothstep(0.85 - 0.5 * wear, 1.15 - 0.5 * wear, 0.5 * fine + 0.5 * coarse + 0.25 * wear);
    rgba = vec4(paint.rgb * (1.0 + grain * rough), paint.a * (1.0 - wear * wears * clamp(0.25 + gone, 0.0, 1.0)));
}
