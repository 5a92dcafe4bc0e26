// The page's controls: sliders, frames and playback.

const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
const sliders = joints.map((_, j) => [...document.querySelectorAll(`input[data-joint="${j}"]`)]);
const frameSlider = element("frame"), frameText = element("frame-text"), playButton = element("play");
const lastFrame = tree.Ts_root.length - 1;
const player = { playing: false, time: data.canonical, direction: 1, now: 0, speed: 4 }; // frames a second

// The value of a slider, written and spoken: degrees of an angle, the input's units of a length.
function valueTexts(slider) {
  const value = Number(slider.value), angle = slider.dataset.unit === "rad";
  if (angle) {
    const degrees = (Math.round((value * 1800) / Math.PI) / 10 + 0).toFixed(1); // + 0: no "-0.0"
    return [`${degrees}°`, `${degrees} degrees`];
  }
  const text = `${Number(value.toPrecision(3))} ${slider.dataset.unit}`.trim();
  return [text, text];
}

function showValues() {
  sliders.forEach((ofJoint, j) =>
    ofJoint.forEach((slider, k) => {
      slider.value = pose.states[j][k];
      showValue(slider);
    }));
}

function showValue(slider) {
  const [text, words] = valueTexts(slider);
  slider.parentElement.querySelector("output").textContent = text;
  slider.setAttribute("aria-valuetext", words);
}

function showFrame(posed = false) {
  frameSlider.value = player.time;
  const words = `frame ${pose.frame}${pose.frame === data.canonical ? ", canonical" : ""}`;
  frameText.textContent = posed ? "posed by hand" : `${words}, of 0 to ${lastFrame}`;
  frameSlider.setAttribute("aria-valuetext", posed ? `posed by hand, after ${words}` : words);
}

function setFrame(time) {
  player.time = time;
  poseAt(time);
  showValues();
  showFrame();
  redraw();
}

function setState(j, state) {
  play(false);
  pose.states[j] = state;
  showValues();
  showFrame(true);
  redraw();
}

function resetJoints() {
  play(false);
  player.direction = 1;
  setFrame(data.canonical);
}

function play(on) {
  if (player.playing === on) return;
  player.playing = on;
  player.now = 0;
  playButton.textContent = on ? "❚❚" : "▶";
  playButton.setAttribute("aria-label", on ? "Pause" : "Play the fitted sequence");
  if (!on) setFrame(Math.round(player.time));
  redraw();
}

// To and fro. Beside the input's points the model goes from frame to frame; alone, it glides.
function advance(now) {
  const elapsed = player.now ? Math.min((now - player.now) / 1000, 0.25) : 0;
  player.now = now;
  player.phase = Math.min(Math.max((player.phase ?? player.time) + player.direction * player.speed * elapsed, 0), lastFrame);
  if (player.phase === lastFrame) player.direction = -1;
  if (player.phase === 0) player.direction = 1;
  const time = shown.input || reducedMotion ? Math.round(player.phase) : player.phase;
  if (time !== player.time) setFrame(time);
}

sliders.forEach((ofJoint, j) =>
  ofJoint.forEach((slider) => {
    slider.addEventListener("input", () => setState(j, ofJoint.map((each) => Number(each.value))));
    const row = slider.closest("li");
    const activate = (on) => () => {
      shown.active = on ? j : null;
      redraw();
    };
    row.addEventListener("pointerenter", activate(true));
    row.addEventListener("pointerleave", activate(false));
    slider.addEventListener("focus", activate(true));
    slider.addEventListener("blur", activate(false));
  }));
frameSlider.addEventListener("input", () => {
  play(false);
  setFrame(Number(frameSlider.value));
});
playButton.addEventListener("click", () => {
  player.phase = player.time;
  play(!player.playing);
});
element("reset").addEventListener("click", resetJoints);
element("reset-view").addEventListener("click", () => {
  resetView();
  redraw();
});
element("up").addEventListener("change", (event) => {
  resetView(event.target.value);
  redraw();
});
for (const choice of ["mode", "colouring"])
  for (const radio of document.querySelectorAll(`input[name=${choice}]`))
    radio.addEventListener("change", () => {
      shown[choice] = radio.value;
      redraw();
    });
for (const name of ["axes", "badges", "input"]) {
  const box = element(`show-${name}`);
  shown[name] = box.checked;
  box.addEventListener("change", () => {
    shown[name] = box.checked;
    if (name === "input") setFrame(Math.round(player.time));
    redraw();
  });
}
