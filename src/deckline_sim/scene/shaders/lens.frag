#version 330
uniform sampler2D radiance;
uniform sampler2D nearness;  // 1 / depth along the optical axis, 0 in the sky
uniform sampler2D lens_map;  // pixel of the pinhole's picture that each pixel of the lens' picture sees
uniform float agree;         // largest ratio of neighbouring depths that are taken for one surface
layout(location = 0) out vec4 rgb;
layout(location = 1) out float depth_m;

const float STRAIGHT = 0.1;  // largest bend of 1 / depth on one plane, relative to its step

float near_at(ivec2 at) {
    return texelFetch(nearness, clamp(at, ivec2(0), textureSize(nearness, 0) - 1), 0).r;
}

// Whether the pixels on both sides of a pair lie on its straight line.
bool straight(ivec2 at, ivec2 step) {
    float a = near_at(at - step), b = near_at(at), c = near_at(at + step), d = near_at(at + 2 * step);
    return abs(a - 2.0 * b + c) <= STRAIGHT * abs(c - b) && abs(b - 2.0 * c + d) <= STRAIGHT * abs(c - b);
}

// Near the horizon depths of one plane differ much, but 1 / depth is linear there as everywhere on a plane.
bool one_plane(ivec2 at) {
    ivec2 u = ivec2(1, 0), v = ivec2(0, 1);
    float n00 = near_at(at), n10 = near_at(at + u), n01 = near_at(at + v), n11 = near_at(at + u + v);
    float step = max(abs(n01 - n00), abs(n10 - n00));
    bool level = abs(n00 - n10 - n01 + n11) <= STRAIGHT * step && min(min(n00, n10), min(n01, n11)) > 0.0;
    return level && (abs(n01 - n00) > abs(n10 - n00) ? straight(at, v) && straight(at + u, v)
        : straight(at, u) && straight(at + v, u));
}

void main() {
    vec2 at = texelFetch(lens_map, ivec2(gl_FragCoord.xy), 0).rg;
    ivec2 last = textureSize(nearness, 0) - 1;
    ivec2 corner = clamp(ivec2(floor(at)), ivec2(0), last - 1);
    vec2 part = clamp(at - vec2(corner), 0.0, 1.0);
    vec3 c00 = texelFetch(radiance, corner, 0).rgb, c10 = texelFetch(radiance, corner + ivec2(1, 0), 0).rgb;
    vec3 c01 = texelFetch(radiance, corner + ivec2(0, 1), 0).rgb, c11 = texelFetch(radiance, corner + ivec2(1), 0).rgb;
    rgb = vec4(mix(mix(c00, c10, part.x), mix(c01, c11, part.x), part.y), 1.0);
    float n00 = texelFetch(nearness, corner, 0).r, n10 = texelFetch(nearness, corner + ivec2(1, 0), 0).r;
    float n01 = texelFetch(nearness, corner + ivec2(0, 1), 0).r, n11 = texelFetch(nearness, corner + ivec2(1), 0).r;
    float least = min(min(n00, n10), min(n01, n11)), most = max(max(n00, n10), max(n01, n11));
    // 1 / depth of a plane is linear in the picture; across an edge the nearest pixel is taken.
    float between = mix(mix(n00, n10, part.x), mix(n01, n11, part.x), part.y);
    float nearest = part.y < 0.5 ? (part.x < 0.5 ? n00 : n10) : (part.x < 0.5 ? n01 : n11);
    float n = most <= agree * least || one_plane(corner) ? between : nearest;
    depth_m = n > 0.0 ? 1.0 / n : -1.0;
}
