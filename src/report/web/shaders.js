// The programs of the graphics card.

const FACE_VERTEX = `#version 300 es
layout(location = 0) in uvec3 cell;
layout(location = 1) in uvec4 face;  // side, kind, openness, sun
uniform mat4 clipFromOcc;
uniform vec3 lower;
uniform float voxel;
uniform vec3 palette[12];
uniform vec3 sun;
out vec2 place;
out float depth;
flat out vec3 color;
flat out vec4 open;
flat out vec4 lit;

void main() {
  uint axis = face.x >> 1u;
  float side = float(face.x & 1u);
  vec3 corner = vec3(0.0);
  place = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  corner[axis] = side;
  corner[(axis + 1u) % 3u] = place.x;
  corner[(axis + 2u) % 3u] = place.y;
  gl_Position = clipFromOcc * vec4(lower + (vec3(cell) + corner) * voxel, 1.0);
  depth = gl_Position.w;
  color = palette[face.y];
  open = vec4(uvec4(face.z, face.z >> 2u, face.z >> 4u, face.z >> 6u) & 3u) / 3.0;
  float towards = max(0.0, (side * 2.0 - 1.0) * sun[axis]);
  lit = towards * vec4(uvec4(face.w, face.w >> 1u, face.w >> 2u, face.w >> 3u) & 1u);
}`;

const FACE_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
in float depth;
flat in vec3 color;
flat in vec4 open;
flat in vec4 lit;
uniform vec3 haze;
uniform vec2 hazeFromTo;
out vec4 pixel;

float between(vec4 corners) {
  return mix(mix(corners.x, corners.y, place.x), mix(corners.z, corners.w, place.x), place.y);
}

void main() {
  float light = 0.76 * (0.55 + 0.45 * between(open)) + 0.44 * between(lit);
  vec2 perPixel = fwidth(place);
  vec2 toEdge = min(place, 1.0 - place) / perPixel;
  float large = clamp((1.0 / max(perPixel.x, perPixel.y) - 2.5) / 9.0, 0.0, 1.0);
  float edge = 1.0 - smoothstep(0.4, 1.1, min(toEdge.x, toEdge.y));
  vec3 shaded = min(color * light * (1.0 - 0.28 * large * edge), 1.0);
  float far = clamp((depth - hazeFromTo.x) / (hazeFromTo.y - hazeFromTo.x), 0.0, 1.0);
  pixel = vec4(mix(shaded, haze, 0.28 * far), 1.0);
}`;

// A line is a rectangle between its ends, as wide in pixels as it says; both ends are kept before
// the observer.
const LINE_VERTEX = `#version 300 es
layout(location = 0) in vec3 from;
layout(location = 1) in vec3 to;
layout(location = 2) in vec4 colorWidth;
uniform mat4 clipFromOcc;
uniform vec2 size;
flat out vec3 color;
const float NEAR = 0.05;

void main() {
  vec4 a = clipFromOcc * vec4(from, 1.0);
  vec4 b = clipFromOcc * vec4(to, 1.0);
  if (a.w < NEAR && b.w > NEAR) a = mix(a, b, (NEAR - a.w) / (b.w - a.w));
  if (b.w < NEAR && a.w > NEAR) b = mix(b, a, (NEAR - b.w) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) * size;
  vec2 unit = along / max(length(along), 1e-6);
  vec4 end = (gl_VertexID & 1) == 0 ? a : b;
  float side = gl_VertexID < 2 ? -1.0 : 1.0;
  end.xy += side * vec2(-unit.y, unit.x) * colorWidth.w / size * end.w;
  gl_Position = max(a.w, b.w) < NEAR ? vec4(2.0, 2.0, 2.0, 1.0) : end;
  color = colorWidth.rgb;
}`;

const TRIANGLE_VERTEX = `#version 300 es
layout(location = 0) in vec3 place;
layout(location = 1) in vec3 ink;
uniform mat4 clipFromOcc;
flat out vec3 color;

void main() {
  gl_Position = clipFromOcc * vec4(place, 1.0);
  color = ink;
}`;

const PLAIN_FRAGMENT = `#version 300 es
precision mediump float;
flat in vec3 color;
uniform float opacity;
out vec4 pixel;

void main() {
  pixel = vec4(color * opacity, opacity);
}`;
