// Shapes as arrays of corners and triangles. Pure: it knows neither the page nor the scene.

// Sums of the adjoining triangles' normals, each as long as its triangle is large.
function vertexNormals(position, triangles) {
  const normals = new Float32Array(position.length);
  const corner = (i) => [position[3 * i], position[3 * i + 1], position[3 * i + 2]];
  for (let t = 0; t < triangles.length; t += 3) {
    const abc = triangles.subarray(t, t + 3), [a, b, c] = [...abc].map(corner);
    const normal = cross(add(b, scaled(a, -1)), add(c, scaled(a, -1)));
    for (const i of abc) for (let k = 0; k < 3; k++) normals[3 * i + k] += normal[k];
  }
  return normals;
}

// A profile of (radius, height), turned about the z axis; its rings have corners of their own, so that edges are sharp.
function surfaceOfRevolution(profile, sides) {
  const position = [], triangles = [];
  for (let ring = 0; ring + 1 < profile.length; ring++)
    for (let side = 0; side <= sides; side++) {
      const angle = (2 * Math.PI * side) / sides, first = position.length / 3;
      for (const [radius, z] of [profile[ring], profile[ring + 1]])
        position.push(radius * Math.cos(angle), radius * Math.sin(angle), z);
      if (side < sides) triangles.push(first, first + 2, first + 1, first + 1, first + 2, first + 3);
    }
  return { position: new Float32Array(position), triangles: new Uint16Array(triangles) };
}

// The outline (radius, height) of a joint's glyph, as its kind says: a disc where it turns about its axis, a sleeve where
// it slides, a ball where it turns in all directions. A rod with an arrow is the axis.
function glyphProfile({ turns, slides }) {
  const collar = (inner, outer, height, middle = []) =>
    [[inner, -height], [outer, -height], ...middle, [outer, height], [inner, height]];
  const rod = (middle) => [[0, -0.24], [0.008, -0.24], ...middle, [0.008, 0.22], [0.026, 0.22], [0, 0.3]];
  const ball = [0, 1, 2, 3, 4, 5, 6].map((i) => [0.05 * Math.sin((i * Math.PI) / 6), -0.05 * Math.cos((i * Math.PI) / 6)]);
  if (turns === "all") return slides === "axis" ? rod(ball) : ball;
  if (slides === "none") return rod(collar(0.008, 0.055, 0.01));
  return rod(collar(0.008, 0.022, 0.09, turns === "axis" ? collar(0.022, 0.055, 0.01) : []));
}
