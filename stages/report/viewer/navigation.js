// Mouse, touch and keys on the view.

const pointers = new Map();

function orbit(right, down) {
  camera.azimuth -= right;
  camera.elevation = Math.min(Math.max(camera.elevation + down, -1.55), 1.55);
}

function pan(right, down) {
  const [side, up] = viewAxes(), step = (2 * camera.distance * Math.tan(FIELD / 2)) / canvas.clientHeight;
  camera.target = add(camera.target, add(scaled(side, -right * step), scaled(up, down * step)));
}

function zoom(factor) {
  camera.distance = Math.min(Math.max(camera.distance * factor, 0.1), 50);
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
});
for (const end of ["pointerup", "pointercancel"])
  canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const here = [event.clientX, event.clientY], moved = [here[0] - before[0], here[1] - before[1]];
  if (pointers.size === 2) {
    const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
    zoom(apart(before) / apart(here));
    pan(moved[0] / 2, moved[1] / 2);
  } else if (event.shiftKey || event.buttons & 6) pan(...moved);
  else orbit(moved[0] * 0.008, moved[1] * 0.008);
  pointers.set(event.pointerId, here);
  redraw();
});
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 60) * 0.003));
  redraw();
}, { passive: false });
canvas.addEventListener("keydown", (event) => {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (arrows && event.shiftKey) pan(...scaled(arrows, 30));
  else if (arrows) orbit(...scaled(arrows, 0.12));
  else if (event.key === "+" || event.key === "=") zoom(0.88);
  else if (event.key === "-") zoom(1 / 0.88);
  else if (event.key === "0" || event.key === "Home") resetView();
  else if (event.key === " ") playButton.click();
  else return;
  event.preventDefault();
  redraw();
});
new ResizeObserver(redraw).observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
