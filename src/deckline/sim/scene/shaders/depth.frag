#version 330
in float axial_m;
out float depth_m;
void main() { depth_m = axial_m; }
