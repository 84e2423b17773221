// Slow motion of an injection: each element of the section says in its attributes which course moves, fills or names it;
// `Section` of plugins/features/anatomy.py draws the still by the same rules. `panes` selects the charts over time, which
// have a line at the time shown.
function anatomyOf(root, panes) {
  const all = (query) => [...root.querySelectorAll(query)], NS = "http://www.w3.org/2000/svg";
  const player = root.querySelector(".player"), [button, slider, told] = player.children;
  let frames = null, words = null, time = [0], last = 0, length = 0, at = 0, playing = 0;

  function show(frame) {
    at = Math.min(Math.max(frame, 0), last);
    const i = Math.floor(at), now = (name) => frames[name][i];
    for (const e of all("[data-move]")) e.setAttribute("transform", `translate(0 ${(e.dataset.scale * now(e.dataset.move)).toFixed(2)})`);
    for (const e of all("[data-fill]")) e.setAttribute("fill-opacity", 0.08 + 0.9 * Math.max(now(e.dataset.fill), 0) / e.dataset.full);
    for (const e of all("[data-glow]")) e.setAttribute("opacity", Math.max(now(e.dataset.glow), 0) / e.dataset.full);
    for (const e of all("[data-say]")) e.textContent = `${words[e.dataset.say][i].toFixed(e.dataset.digits).replace(/^-(0(\.0+)?)$/, "$1").replace("-", "−")} ${e.dataset.unit}`;
    for (const pane of document.querySelectorAll(panes)) draw(pane, time[i]);
    slider.value = i;
    told.textContent = `${time[i].toFixed(0)} µs`;
  }
  function draw(pane, x) {
    const [low, high] = pane.dataset.x.split(" ").map(Number), across = 10 * pane.getAttribute("width") * (x - low) / (high - low);
    const line = pane.querySelector(".now") || pane.appendChild(document.createElementNS(NS, "path"));
    line.setAttribute("class", "now");
    line.setAttribute("vector-effect", "non-scaling-stroke");
    line.setAttribute("d", `M${across} 0V${10 * pane.getAttribute("height")}`);
  }
  function pause() { cancelAnimationFrame(playing); playing = 0; button.textContent = "▶ Play"; }
  function play() {
    if (at >= last) at = 0;
    const from = performance.now() - at / last * length;
    button.textContent = "❚❚ Pause";
    const step = (clock) => {
      show((clock - from) / length * last);
      if (at >= last) pause(); else playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  }
  // Courses by name at equal steps of time [µs], those that are told in words, and the seconds that they last on the
  // screen; the time shown stays what it is but for the first ones, which show a frame.
  function take(courses, said, seconds, frame) {
    const now = frames ? (time[Math.floor(at)] - courses.time[0]) / (courses.time[1] - courses.time[0]) : frame;
    [frames, words, time, last, length] = [courses, said, courses.time, courses.time.length - 1, 1000 * seconds];
    slider.max = last;
    if (!playing) show(now);
  }
  button.addEventListener("click", () => (playing ? pause() : play()));
  slider.addEventListener("input", () => { pause(); show(Number(slider.value)); });
  document.addEventListener("reader", ({ detail }) => {
    if (frames && !playing && detail.title === "time, µs") show((detail.x - time[0]) / (time[last] - time[0]) * last);
  });
  for (const e of [player, ...all(".player-words")]) e.hidden = false;
  return { take, pause, show };
}

function startAnatomy() {
  const { seconds, still, frames } = JSON.parse(document.getElementById("frames").textContent);
  const anatomy = anatomyOf(document.getElementById("anatomy"), "#course .pane");
  anatomy.take(frames, frames, seconds, still);
  addEventListener("beforeprint", () => { anatomy.pause(); anatomy.show(still); });
}
