// Draws one or two images, pixel by pixel: linear values of up to three planes to display codes.

uniform sampler2D planesA[3];
uniform sampler2D planesB[3];
uniform usampler2D numbersA[3];
uniform usampler2D numbersB[3];
uniform sampler2D colormap;
uniform ivec2 sizeA, sizeB;    // pixels
uniform int kindA, kindB;      // see KIND in images.js
uniform int countA, countB;    // planes
uniform vec3 lowA, lowB;       // ranges of the planes
uniform vec3 highA, highB;
uniform vec2 origin;           // the images' top left corner in pixels of the canvas, y down
uniform float zoom;            // pixels of the canvas per pixel of the image
uniform float height;          // of the canvas
uniform float wipe;            // x from which on B is drawn
uniform int metric;            // 0: no difference, 1: absolute, 2: squared, 3: relative
uniform int operator;          // tone map
uniform float gain;            // 2^exposure
uniform bool marking, inStops, asLuminance;
out vec4 color;

const vec3 GROUND = vec3(42.0, 42.0, 42.0) / 255.0;
const vec3 NOTHING = vec3(96.0) / 255.0;
const vec3 NAN_MARK = vec3(1.0, 0.0, 1.0);
const vec3 INFINITE_MARK = vec3(1.0, 0.69, 0.0);
const vec3 NEGATIVE_MARK = vec3(0.0, 0.71, 1.0);
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

struct Sum {
  vec3 value;
  int count;
  bool nan, infinite, negative;
};

// By bits: compilers may take for granted that there is no NaN.
uvec3 magnitude(vec3 v) {
  return floatBitsToUint(v) & 0x7FFFFFFFu;
}

bvec3 infinite(vec3 v) {
  return equal(magnitude(v), uvec3(0x7F800000u));
}

bvec3 notANumber(vec3 v) {
  return greaterThan(magnitude(v), uvec3(0x7F800000u));
}

bool isInside(ivec2 p, ivec2 size) {
  return p.x >= 0 && p.y >= 0 && p.x < size.x && p.y < size.y;
}

// Values at a pixel in three planes; an index of samplers has to be constant.
#define FETCHED(type, planes, p) \
  type(texelFetch(planes[0], p, 0).r, texelFetch(planes[1], p, 0).r, texelFetch(planes[2], p, 0).r)

vec3 texel(ivec2 p, bool second) {
  return second ? FETCHED(vec3, planesB, p) : FETCHED(vec3, planesA, p);
}

uvec3 number(ivec2 p, bool second) {
  return second ? FETCHED(uvec3, numbersB, p) : FETCHED(uvec3, numbersA, p);
}

/** Return a color for each different tuple of numbers, black for zeros, as clshade.images.figures does. */
vec3 numberColor(uvec3 numbers, int count) {
  uint state = 0u;
  bool nothing = true;
  for (int k = 0; k < count; k++) {
    nothing = nothing && numbers[k] == 0u;
    state = (state ^ numbers[k]) * 0x9E3779B1u;
    state = (state ^ (state >> 15)) * 0x85EBCA6Bu;
    state ^= state >> 13;
  }
  uvec3 codes = (uvec3(state, state >> 8, state >> 16) & 255u) / 4u * 3u + 64u;
  return nothing ? vec3(0.0) : vec3(codes) / 255.0;
}

vec3 difference(vec3 a, vec3 b) {
  bvec3 nanA = notANumber(a), nanB = notANumber(b);
  vec3 error = abs(a - b);
  if (metric == 2) error *= error;
  if (metric == 3) error /= abs(b) + 0.01;
  for (int k = 0; k < 3; k++) if ((nanA[k] && nanB[k]) || a[k] == b[k]) error[k] = 0.0;
  return error;
}

void add(inout Sum sum, vec3 value) {
  sum.value += value;
  sum.count++;
  sum.nan = sum.nan || any(notANumber(value));
  sum.infinite = sum.infinite || any(infinite(value));
  sum.negative = sum.negative || any(lessThan(value, vec3(0.0)));
}

vec3 colormapped(float position) {
  return texelFetch(colormap, ivec2(int(clamp(position, 0.0, 0.999) * 256.0), 0), 0).rgb;
}

/** Return the display color of linear light. */
vec3 lightColor(Sum sum) {
  if (marking && sum.nan) return NAN_MARK;
  if (marking && sum.infinite) return INFINITE_MARK;
  if (marking && sum.negative) return NEGATIVE_MARK;
  vec3 linear = sum.value / float(sum.count);
  if (asLuminance || inStops) linear = vec3(dot(linear, LUMINANCE));
  if (!inStops) return toneMapped(linear * gain, operator);
  float light = linear.x * gain;
  return light > 0.0 ? colormapped((log2(light) + 8.0) / 12.0) : vec3(0.0);
}

/** Return the display color of values that are no light. */
vec3 valueColor(vec3 value, int kind, int count, vec3 low, vec3 high) {
  if (marking && any(notANumber(value))) return NAN_MARK;
  if (any(infinite(value)) || any(notANumber(value))) return NOTHING;
  if (kind == 2) return value == vec3(0.0) ? vec3(0.0) : clamp(value * 0.5 + 0.5, 0.0, 1.0);
  vec3 spread = vec3(0.5);
  for (int k = 0; k < 3; k++) if (high[k] != low[k]) spread[k] = (value[k] - low[k]) / (high[k] - low[k]);
  if (kind == 1) return colormapped(spread.x);
  if (kind == 5) spread = fract(value);
  if (count == 2) spread.z = 0.0;
  return clamp(spread, 0.0, 1.0);
}

vec3 drawn(vec2 at, bool second) {
  ivec2 size = second ? sizeB : sizeA;
  int kind = second ? kindB : kindA;
  ivec2 center = ivec2(floor(at));
  if (metric != 0) size = min(sizeA, sizeB);
  if (!isInside(center, size)) return GROUND;
  if (kind == 3) {
    uvec3 numbers = number(center, second);
    if (metric == 0) return numberColor(numbers, second ? countB : countA);
    return kindB == 3 && numbers == number(center, true) ? vec3(0.0) : vec3(1.0);
  }
  if (kind != 0 && metric == 0) {
    if (second) return valueColor(texel(center, true), kindB, countB, lowB, highB);
    return valueColor(texel(center, false), kindA, countA, lowA, highA);
  }
  int side = clamp(int(1.0 / zoom + 0.5), 1, 8); // reduced images are means in linear light
  Sum sum = Sum(vec3(0.0), 0, false, false, false);
  for (int j = 0; j < side; j++) {
    for (int i = 0; i < side; i++) {
      vec2 place = side == 1 ? at : at + ((vec2(i, j) + 0.5) / float(side) - 0.5) / zoom;
      ivec2 p = ivec2(floor(place));
      if (!isInside(p, size)) continue;
      add(sum, metric != 0 ? difference(texel(p, false), texel(p, true)) : texel(p, second));
    }
  }
  if (sum.count == 0) return GROUND;
  return lightColor(sum);
}

void main() {
  vec2 place = vec2(gl_FragCoord.x, height - gl_FragCoord.y);
  vec3 codes = drawn((place - origin) / zoom, place.x >= wipe);
  color = vec4(floor(codes * 255.0 + 0.5) / 255.0, 1.0);
}
