"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = (id) => document.getElementById(id);
  const last = data.pictures.length - 1;
  let now = 0;
  let timer = null;
  const overlay = at("overlay");
  const space = "http://www.w3.org/2000/svg";
  const trace = (lines) => {
    const nodes = [];
    for (const [name, parts] of Object.entries(lines || {})) {
      for (const part of parts) {
        for (const layer of ["under", "line"]) {
          const line = document.createElementNS(space, "polyline");
          line.setAttribute("class", `${name} ${layer}`);
          line.setAttribute("points", part.map((one) => one.join(",")).join(" "));
          nodes.push(line);
        }
        if (name === "plan") {
          for (const [x, y] of part) {
            const dot = document.createElementNS(space, "circle");
            dot.setAttribute("class", name);
            dot.setAttribute("cx", x);
            dot.setAttribute("cy", y);
            dot.setAttribute("r", "2.1");
            nodes.push(dot);
          }
        }
      }
    }
    overlay.replaceChildren(...nodes);
  };
  if (overlay) {
    overlay.setAttribute("viewBox", `0 0 ${data.size[0]} ${data.size[1]}`);
    at("planned").addEventListener("input", () => { overlay.classList.toggle("off", !at("planned").checked); });
  }
  const show = (place) => {
    now = Math.min(Math.max(place, 0), last);
    const step = data.steps[now];
    at("picture").src = data.pictures[now];
    at("picture").alt = `camera: ${step.place}`;
    at("scrubber").value = String(now);
    at("scrubber").setAttribute("aria-valuetext", step.place);
    at("place").textContent = step.place;
    at("decision").textContent = step.decision ? `decides ${step.decision}` : "";
    at("decision").hidden = step.decision === "";
    at("decision").classList.toggle("none", step.substituted);
    at("executed").textContent = step.executed ? `executed ${step.executed}${step.substituted ? " (fail-safe, not the policy's)" : ""}` : "";
    at("state").textContent = step.state;
    if (overlay) {
      trace(step.lines);
      at("plan").textContent = step.plan;
    }
    at("reply").textContent = step.reply;
    at("reply").hidden = step.reply === "";
  };
  const stop = () => {
    clearInterval(timer);
    timer = null;
    at("play").textContent = "Play";
  };
  const play = () => {
    if (timer !== null) return stop();
    if (now === last) show(0);
    at("play").textContent = "Pause";
    timer = setInterval(() => {
      show(now + 1);
      if (now === last) stop();
    }, 1000 / data.fps);
    return undefined;
  };
  at("play").addEventListener("click", play);
  at("previous").addEventListener("click", () => { stop(); show(now - 1); });
  at("next").addEventListener("click", () => { stop(); show(now + 1); });
  at("scrubber").addEventListener("input", () => { stop(); show(Number(at("scrubber").value)); });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " " && event.target.closest("button, #planned")) return;
    const moves = { ArrowLeft: now - 1, ArrowRight: now + 1, Home: 0, End: last };
    if (event.key === " ") play();
    else if (event.key in moves) { stop(); show(moves[event.key]); }
    else return;
    event.preventDefault();
  });
  show(0);
})();
