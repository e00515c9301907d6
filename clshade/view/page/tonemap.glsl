// Tone maps: see clshade.images.tonemap.

vec3 srgbCurve(vec3 x) {
  return mix(1.055 * pow(max(x, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 hablePartial(vec3 x) {
  // Shoulder strength 0.15, linear strength 0.5, linear angle 0.1, toe strength 0.2, toe 0.02 / 0.3.
  return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
}

vec3 neutral(vec3 x) {
  float lowest = min(x.r, min(x.g, x.b));
  vec3 colors = x - (lowest <= 0.08 ? lowest - lowest * lowest / 0.16 : 0.04);
  float peak = max(colors.r, max(colors.g, colors.b));
  if (peak <= 0.76) return colors;
  float mapped = 1.0 - 0.0576 / (peak - 0.52);
  float kept = 1.0 / (0.15 * (peak - mapped) + 1.0);
  return colors * (mapped / peak * kept) + mapped * (1.0 - kept);
}

/** Return AgX's curve, encoded for a display of exponent 2.2. */
vec3 agx(vec3 x) {
  // Shares of the primaries of Rec. 709 in white, of which a fifth is mixed into each; its inverse takes it out again.
  const vec3 shares = vec3(0.21199465, 0.39215085, 0.39585450);
  vec3 inset = 0.8 * x + 0.2 * dot(shares, x);
  vec3 away = (min(log2(max(inset, vec3(0.18 / 1024.0)) / 0.18), vec3(6.5))) / 16.5;
  vec3 toe = step(vec3(0.0), -away);
  vec3 power = mix(vec3(3.25), vec3(3.0), toe);
  vec3 span = mix(vec3(6.5 / 16.5), vec3(10.0 / 16.5), toe);
  vec3 bend = (pow(4.0 * span, power) - 1.0) / pow(span, power);
  vec3 curve = 0.5 + 2.0 * away * pow(1.0 + bend * pow(abs(away), power), -1.0 / power);
  return (curve - 0.2 * dot(shares, curve)) / 0.8;
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
  if (operator == 5) y = neutral(x);
  if (operator == 6) y = pow(clamp(agx(x), 0.0, 1.0), vec3(2.2));
  y = clamp(y, 0.0, 1.0);
  return operator == 0 ? y : srgbCurve(y);
}
