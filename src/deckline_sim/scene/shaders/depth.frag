#version 330
uniform float label;  // what is drawn, from 1; 0: measure its depth
in float axial_m;
out float value;
void main() { value = label > 0.0 ? label : axial_m; }
