// The drawing of a picture: the model, and the numbers of its parts over it.

// Part numbers over the view.
const badges = data.parts.map((part, i) => {
  const badge = document.createElement("span");
  badge.className = "badge";
  badge.textContent = part.id;
  badge.style.setProperty("--part", part.colour);
  if (!centroids[i]) badge.hidden = true;
  element("badges").append(badge);
  return badge;
});

function placeBadges(motions) {
  element("badges").hidden = !shown.badges;
  if (!shown.badges) return;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  const T = multiply(projectionMatrix(width / height), viewMatrix());
  badges.forEach((badge, part) => {
    if (!centroids[part]) return;
    const [x, y, z, w] = apply(T, apply(motions[part], centroids[part]));
    badge.style.transform = `translate(${((x / w + 1) / 2) * width}px, ${((1 - y / w) / 2) * height}px) translate(-50%, -50%)`;
    badge.style.zIndex = Math.round(1000 * (1 - z / w));
  });
}

let renderer = null, draws = 0, requested = false;

// Draws once before the next picture, however often it is called.
function redraw() {
  if (requested) return;
  requested = true;
  requestAnimationFrame((now) => {
    requested = false;
    if (player.playing) advance(now);
    const motions = partMotions();
    if (renderer) {
      renderer.draw(motions);
      placeBadges(motions);
    }
    draws += 1;
    if (player.playing) redraw();
  });
}
