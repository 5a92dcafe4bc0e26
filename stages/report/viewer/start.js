// The start: a renderer where there is WebGL 2, and the canonical frame.

const gl = canvas.getContext("webgl2", { antialias: true });
if (gl) {
  renderer = new Renderer(gl);
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => {
    renderer = new Renderer(gl);
    redraw();
  });
} else {
  element("no-webgl").hidden = false;
  canvas.hidden = true;
}
resetView();
setFrame(data.canonical);

// For tests, and for whoever opens the console: parts' middles are in the input's coordinates.
window.reart = {
  get frame() { return pose.frame; },
  get playing() { return player.playing; },
  get draws() { return draws; },
  get states() { return pose.states; },
  get centroids() { return partMotions().map((T, part) => centroids[part] && toInput(apply(T, centroids[part]).slice(0, 3))); },
  setFrame,
  setState,
};
