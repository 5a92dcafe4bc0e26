// The kinematic tree, as stages/kernels/kinematics/tree.py has it. Pure: it knows the scene's data, but not the page.
// A joint has a state, a number for each row of its basis. Kinds of joints differ in their basis alone.

// Where a point of the input lies in the view: the scene lies between -1 and 1 on each axis.
function pointInView(p, { centre, half }) {
  return scaled(add(p, scaled(centre, -1)), 1 / half);
}

// A rigid transform of the input's coordinates, as three rows of four, as one of the view's.
function transformInView(T, view) {
  const columns = [0, 1, 2].map((column) => [T[column], T[4 + column], T[8 + column]]);
  const origin = add(turned(columns, view.centre), [T[3], T[7], T[11]]);
  return fromColumns(...columns, pointInView(origin, view));
}

// The tree of the scene's data, in the view's coordinates.
function treeInView(data) {
  return {
    root: data.root,
    parts: data.parts.length,
    joints: data.joints.map((joint) => ({
      ...joint,
      point: pointInView(joint.point, data),
      place: pointInView(joint.place, data),
      basis: joint.basis.map((row) => [...row.slice(0, 3), ...scaled(row.slice(3), 1 / data.half)]),
    })),
    Ts_root: data.T_frame_root.map((T) => transformInView(T, data)),
  };
}

// A child against its parent: a turn by a rotation vector about the joint's point, then a slide.
function jointTransform({ basis, point }, state) {
  const motion = basis.reduce((sum, row, i) => add(sum, scaled(row, state[i])), [0, 0, 0, 0, 0, 0]);
  const vector = motion.slice(0, 3), slide = motion.slice(3);
  const columns = rotation(unit(vector), Math.hypot(...vector));
  return fromColumns(...columns, add(add(point, scaled(turned(columns, point), -1)), slide));
}

// Forward kinematics: where the canonical points of each part lie, given a state of each joint and the root's transform.
function partTransforms(tree, states, T_root) {
  const Ts = Array.from({ length: tree.parts }, identity);
  const place = (part, T) => {
    Ts[part] = T;
    tree.joints.forEach((joint, j) => {
      if (joint.parent === part) place(joint.child, multiply(T, jointTransform(joint, states[j])));
    });
  };
  place(tree.root, T_root);
  return Ts;
}

// A rigid transform between two others.
function transformBetween(a, b, share) {
  const T = between(a, b, share);
  const x = unit(T.slice(0, 3)), z = unit(cross(x, T.slice(4, 7)));
  return fromColumns(x, cross(z, x), z, T.slice(12, 15));
}
