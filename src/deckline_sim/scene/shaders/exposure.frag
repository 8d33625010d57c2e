#version 330
uniform sampler2D radiance;
uniform sampler2D nearness;  // 1 / depth along the optical axis, 0 in the sky
uniform vec4 lens;           // fx, fy, cx, cy
uniform vec3 moved;          // of the camera during the exposure, m, optical frame
uniform vec3 turned;         // rotation vector of the same, rad
out vec4 rgb;

const int MOST_TAPS = 32;

vec2 seen(vec3 point) { return point.xy / max(point.z, 0.05) * lens.xy + lens.zw; }

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 ray = vec3((vec2(pixel) - lens.zw) / lens.xy, 1.0);
    vec3 shift = -cross(turned, ray) - moved * texelFetch(nearness, pixel, 0).r;
    vec2 start = seen(ray - 0.5 * shift);
    vec2 path = seen(ray + 0.5 * shift) - start;
    float px = length(path);
    if (px < 0.05) {
        rgb = vec4(texelFetch(radiance, pixel, 0).rgb, 1.0);
        return;
    }
    int taps = clamp(int(ceil(px)), 1, MOST_TAPS);
    vec2 size = vec2(textureSize(radiance, 0));
    vec3 sum = vec3(0.0);
    for (int i = 0; i < taps; i++)
        sum += textureLod(radiance, (start + path * (float(i) + 0.5) / float(taps) + 0.5) / size, 0.0).rgb;
    rgb = vec4(sum / float(taps), 1.0);
}
