// Places a vertex in the picture and gives it its colour.
attribute vec3 position;   // points: 0 to 1 within the box; lines: their place
attribute vec3 colour;
attribute vec3 normal;     // world
attribute vec2 quality;    // confidence 0 to 255, number of views

uniform vec3 scale;        // position × scale + shift is relative to the middle of the box
uniform vec3 shift;
uniform mat3 turn;         // R of cam_from_world
uniform vec3 focus;        // the point about which the eye turns
uniform float span;        // distance from the eye to the focus
uniform vec2 lens;         // 1 / half of the picture's width and height at distance 1
uniform vec2 clip;         // nearest and farthest depth
uniform float reach;       // diameter of a point, pixels at depth 1
uniform int look;          // 0 colour, 1 shape, 2 confidence, 3 views, 4 lines
uniform float most_views;
uniform vec3 ramp[17];
uniform vec3 line;

varying vec3 shade;

vec3 clay(vec3 n) {
  float lamp = max(dot(n, vec3(-0.38, -0.53, -0.757)), 0.0);
  return vec3(0.84, 0.82, 0.78) * min(0.15 + 0.3 * max(-n.z, 0.0) + 0.55 * lamp, 1.0);
}

vec3 on_ramp(float value) {
  float place = clamp(value, 0.0, 1.0) * 16.0;
  int first = int(min(place, 15.0));
  return mix(ramp[first], ramp[first + 1], place - float(first));
}

void main() {
  vec3 seen = turn * (position * scale + shift - focus) + vec3(0.0, 0.0, span);
  float near = clip.x, far = clip.y;
  float depth = (seen.z * (far + near) - 2.0 * far * near) / (far - near);
  gl_Position = vec4(lens.x * seen.x, -lens.y * seen.y, depth, seen.z);
  gl_PointSize = clamp(reach / max(seen.z, near), 1.0, 48.0);
  if (look == 0) shade = colour;
  else if (look == 1) shade = clay(turn * normal);
  else if (look == 2) shade = on_ramp(quality.x / 255.0);
  else if (look == 3) shade = on_ramp(quality.y / most_views);
  else shade = line;
}
