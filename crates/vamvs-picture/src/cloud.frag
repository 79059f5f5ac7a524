// Draws points as discs.
precision mediump float;

uniform bool round;       // true for points, false for lines
varying vec3 shade;

void main() {
  vec2 place = gl_PointCoord - 0.5;
  if (round && dot(place, place) > 0.25) discard;
  gl_FragColor = vec4(shade, 1.0);
}
