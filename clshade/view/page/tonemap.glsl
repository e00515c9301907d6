// Tone maps: see clshade.images.tonemap.

vec3 srgbCurve(vec3 x) {
  return mix(1.055 * pow(max(x, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 hablePartial(vec3 x) {
  // Shoulder strength 0.15, linear strength 0.5, linear angle 0.1, toe strength 0.2, toe 0.02 / 0.3.
  return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
}

/** Return display codes in [0, 1] of linear values, exposure applied. NaN and negative values give 0. */
vec3 toneMapped(vec3 linear, int operator) {
  // Every operator has reached its last code at 1e6, whose squares are finite.
  vec3 x = vec3(linear.x > 0.0 ? min(linear.x, 1e6) : 0.0, linear.y > 0.0 ? min(linear.y, 1e6) : 0.0,
                linear.z > 0.0 ? min(linear.z, 1e6) : 0.0);
  vec3 y = x;
  if (operator == 2) y = x / (1.0 + x);
  if (operator == 3) y = hablePartial(2.0 * x) / hablePartial(vec3(11.2));
  if (operator == 4) y = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
  y = clamp(y, 0.0, 1.0);
  return operator == 0 ? y : srgbCurve(y);
}
