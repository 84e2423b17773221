// Slow motion of an injection: each element of the section says in its attributes which course moves, fills or names it;
// `Section` of plugins/features/anatomy.py draws the still by the same rules.
(() => {
  const all = (query) => [...document.querySelectorAll(query)];
  const { seconds, still, frames } = JSON.parse(document.getElementById("frames").textContent);
  const time = frames.time, last = time.length - 1, NS = "http://www.w3.org/2000/svg";
  const player = document.querySelector(".player"), [button, slider, told] = player.children;
  const lines = all("#course .pane").map((pane) => {
    const line = document.createElementNS(NS, "path");
    line.setAttribute("class", "now");
    line.setAttribute("vector-effect", "non-scaling-stroke");
    pane.append(line);
    const [low, high] = pane.dataset.x.split(" ").map(Number), wide = 10 * pane.getAttribute("width");
    return { pane, line, low, high, wide, deep: 10 * pane.getAttribute("height") };
  });
  let at = still, playing = 0;

  function show(frame) {
    at = Math.min(Math.max(frame, 0), last);
    const i = Math.floor(at), now = (name) => frames[name][i];
    for (const e of all("[data-move]")) e.setAttribute("transform", `translate(0 ${(e.dataset.scale * now(e.dataset.move)).toFixed(2)})`);
    for (const e of all("[data-fill]")) e.setAttribute("fill-opacity", 0.08 + 0.9 * Math.max(now(e.dataset.fill), 0) / e.dataset.full);
    for (const e of all("[data-glow]")) e.setAttribute("opacity", Math.max(now(e.dataset.glow), 0) / e.dataset.full);
    for (const e of all("[data-say]")) e.textContent = `${now(e.dataset.say).toFixed(e.dataset.digits).replace(/^-(0(\.0+)?)$/, "$1").replace("-", "−")} ${e.dataset.unit}`;
    for (const l of lines) { const x = l.wide * (time[i] - l.low) / (l.high - l.low); l.line.setAttribute("d", `M${x} 0V${l.deep}`); }
    slider.value = i;
    told.textContent = `${time[i].toFixed(0)} µs`;
  }
  function pause() { cancelAnimationFrame(playing); playing = 0; button.textContent = "▶ Play"; }
  function play() {
    if (at >= last) at = 0;
    const from = performance.now() - at / last * seconds * 1000;
    button.textContent = "❚❚ Pause";
    const step = (clock) => {
      show((clock - from) / (seconds * 1000) * last);
      if (at >= last) pause(); else playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  }
  button.addEventListener("click", () => (playing ? pause() : play()));
  slider.addEventListener("input", () => { pause(); show(Number(slider.value)); });
  for (const { pane, low, high, wide } of lines) {
    pane.closest(".panel").addEventListener("pointermove", (event) => {
      if (playing || event.buttons) return;
      const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(pane.getScreenCTM().inverse());
      const x = low + place.x / wide * (high - low);
      show((x - time[0]) / (time[last] - time[0]) * last);
    });
  }
  addEventListener("beforeprint", () => { pause(); show(still); });
  player.hidden = document.querySelector(".player-words").hidden = false;
  show(still);
})();
