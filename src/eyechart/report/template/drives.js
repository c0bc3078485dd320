"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = (id) => document.getElementById(id);
  const make = (tag, className, text) => {
    const node = document.createElement(tag);
    if (className) node.className = className;
    if (text !== undefined) node.textContent = text;
    return node;
  };

  const themes = ["automatic", "light", "dark"];
  const themed = (theme) => {
    if (theme === "automatic") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    at("theme").textContent = `Theme: ${theme}`;
  };
  let theme = "automatic";
  try { theme = themes.includes(localStorage.getItem("eyechart-theme")) ? localStorage.getItem("eyechart-theme") : theme; } catch { /* a page from a file may have no storage */ }
  themed(theme);
  at("theme").addEventListener("click", () => {
    theme = themes[(themes.indexOf(theme) + 1) % themes.length];
    themed(theme);
    try { localStorage.setItem("eyechart-theme", theme); } catch { /* as above */ }
  });

  const links = new Map([...document.querySelectorAll(".contents a")].map((link) => [link.hash.slice(1), link]));
  const current = () => {
    let last = null;
    for (const id of links.keys()) if (at(id).getBoundingClientRect().top < innerHeight * 0.35) last = id;
    for (const [id, link] of links) {
      if (id === last) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    }
  };
  addEventListener("scroll", () => requestAnimationFrame(current), { passive: true });
  current();

  const filters = ["text", "driver", "scenario", "condition", "ended", "pictures"];
  const field = Object.fromEntries(filters.map((name) => [name, at(`f-${name}`)]));
  for (const name of ["driver", "scenario", "condition", "ended"]) {
    const values = [...new Set(data.episodes.map((one) => one[name]))];
    field[name].replaceChildren(...[["", "all"], ...values.map((value) => [value, value])].map(([value, text]) => {
      const option = make("option", "", text);
      option.value = value;
      return option;
    }));
  }

  const list = at("list");
  const detail = at("detail");
  let listed = [];
  let chosen = 0;

  const matches = (one) => {
    for (const name of ["driver", "scenario", "condition", "ended"]) if (field[name].value && one[name] !== field[name].value) return false;
    if (field.pictures.value && !one.pictures.length) return false;
    const words = field.text.value.toLowerCase();
    return words === "" || one.id.toLowerCase().includes(words) || one.steps.some((step) => step[5] >= 0 && data.texts[step[5]].toLowerCase().includes(words));
  };

  const update = () => {
    const before = listed[chosen];
    listed = data.episodes.filter(matches);
    chosen = Math.max(0, listed.indexOf(before));
    at("status").textContent = `${listed.length} of ${data.episodes.length} episodes match.`;
    list.replaceChildren(...listed.map((one, place) => {
      const item = make("li");
      const button = make("button");
      button.type = "button";
      button.tabIndex = -1;
      button.append(make("span", "", one.run ? `${one.run} · ${one.id}` : one.id), " ", make("span", "n", one.ended));
      button.addEventListener("click", () => choose(place, true));
      item.append(button);
      return item;
    }));
    choose(chosen, false);
  };

  const choose = (place, focus) => {
    const buttons = list.querySelectorAll("button");
    if (!buttons.length) {
      detail.replaceChildren(make("p", "empty", "No episode matches these filters."));
      return;
    }
    const old = buttons[chosen];
    if (old) {
      old.removeAttribute("aria-current");
      old.tabIndex = -1;
    }
    chosen = Math.min(Math.max(place, 0), buttons.length - 1);
    const button = buttons[chosen];
    button.setAttribute("aria-current", "true");
    button.tabIndex = 0;
    const item = button.parentNode;
    list.scrollTop = Math.min(Math.max(list.scrollTop, item.offsetTop + item.offsetHeight - list.clientHeight), item.offsetTop);
    if (focus) button.focus({ preventScroll: true });
    show(listed[chosen]);
  };

  const counted = (steps) => {
    const counts = new Map();
    for (const step of steps) counts.set(step[0], (counts.get(step[0]) || 0) + 1);
    return [...counts].sort((a, b) => b[1] - a[1]).map(([name, count]) => `${count} ${name}`).join(", ");
  };

  const role = (action) => data.roles[action] || "other";

  const gapLine = (steps) => {
    const space = "http://www.w3.org/2000/svg";
    const svg = document.createElementNS(space, "svg");
    svg.setAttribute("class", "gaps");
    svg.setAttribute("viewBox", "0 0 100 40");
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("role", "img");
    const known = steps.map((step) => step[3]).filter((gap) => gap !== null);
    const far = Math.max(1, ...known);
    svg.setAttribute("aria-label", known.length ? `Gap by step, from ${Math.min(...known)} to ${Math.max(...known)} metres; broken where nothing is ahead` : "No gap at any step");
    let points = [];
    const flush = () => {
      if (points.length) {
        const line = document.createElementNS(space, "polyline");
        if (points.length === 1) points.push(points[0].replace(/^[\d.]+/, (x) => String(Number(x) + 0.6)));
        line.setAttribute("points", points.join(" "));
        svg.append(line);
      }
      points = [];
    };
    steps.forEach((step, place) => {
      if (step[3] === null) flush();
      else points.push(`${((place + 0.5) / steps.length * 100).toFixed(2)},${(38 - 36 * step[3] / far).toFixed(2)}`);
    });
    flush();
    const cursor = document.createElementNS(space, "line");
    cursor.setAttribute("y1", "0");
    cursor.setAttribute("y2", "40");
    svg.append(cursor);
    return [svg, cursor, known.length ? far : null];
  };

  const show = (one) => {
    const truth = make("p", "truth", `${one.simulator} · ${one.scenario} · seed ${one.seed} · shown ${one.condition} · ended ${one.ended}${one.detail ? `: ${one.detail}` : ""} · ${one.distance === null ? "—" : one.distance} m · reward ${one.reward}`);
    const told = make("p", "truth", `${one.steps.length} decisions: ${counted(one.steps) || "none"}`);
    const title = make("h3");
    title.append(make("bdi", "", one.id));
    if (!one.steps.length) {
      detail.replaceChildren(title, truth, told);
      return;
    }
    const strip = make("div", "strip");
    strip.setAttribute("aria-hidden", "true");
    const cells = one.steps.map((step) => make("span", `${role(step[1])}${step[2] ? "" : " none"}`));
    strip.append(...cells);
    const [svg, cursor, far] = gapLine(one.steps);
    const key = make("p", "key", `Strip: executed actions, blue proceeds, orange brakes, hatched is the fail-safe.${far === null ? "" : ` Line: gap, up to ${far} m.`}`);
    const label = make("label", "slider");
    label.append(make("span", "unseen", "Step"));
    const slider = make("input");
    slider.type = "range";
    slider.min = "0";
    slider.max = String(one.steps.length - 1);
    slider.value = "0";
    slider.id = "step";
    label.append(slider);
    const image = make("img", "drivepicture");
    image.decoding = "async";
    const line = make("div", "verdictline");
    const words = make("p", "truth");
    words.id = "moment";
    const reply = make("pre", "reply");
    reply.dir = "auto";
    reply.tabIndex = 0;
    reply.setAttribute("role", "group");
    const step = () => {
      const now = Number(slider.value);
      const [decision, executed, own, gap, speed, text] = one.steps[now];
      cells.forEach((cell, place) => cell.classList.toggle("now", place === now));
      const x = ((now + 0.5) / cells.length * 100).toFixed(2);
      cursor.setAttribute("x1", x);
      cursor.setAttribute("x2", x);
      const chip = make("span", `chip ${own ? role(decision) : "none"}`, own ? decision : `no decision: ${decision}`);
      line.replaceChildren(chip, make("span", own ? "against" : "against differs", own ? "executed as decided" : `executed ${executed}: the fail-safe, not the policy's`));
      words.textContent = `Step ${now + 1} of ${one.steps.length} · ${gap === null ? (far === null ? "gap —" : "nothing ahead") : `gap ${gap} m`} · then ${speed === null ? "—" : speed} m/s`;
      slider.setAttribute("aria-valuetext", words.textContent);
      if (one.pictures.length) {
        image.src = data.pictures[one.pictures[Math.min(now, one.pictures.length - 1)]];
        image.alt = `camera at step ${now + 1} of ${one.id}`;
      }
      reply.hidden = text < 0;
      if (text >= 0) {
        reply.textContent = data.texts[text] === "" ? "(empty reply)" : data.texts[text];
        reply.setAttribute("aria-label", `Reply at step ${now + 1}`);
      }
    };
    slider.addEventListener("input", step);
    detail.replaceChildren(title, truth, told, ...(one.pictures.length ? [image] : []), strip, svg, label, key, line, words, reply);
    step();
  };

  at("filters").addEventListener("input", update);
  at("filters").addEventListener("submit", (event) => event.preventDefault());
  at("f-clear").addEventListener("click", () => {
    for (const name of filters) field[name].value = "";
    update();
  });

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const typing = event.target.closest("input, select, textarea");
    if (event.key === "Escape" && typing && list.querySelector("button")) {
      choose(chosen, true);
      return;
    }
    if (typing) return;
    if (event.key === "/") {
      event.preventDefault();
      field.text.focus();
      return;
    }
    const inside = list.contains(event.target);
    const move = { j: 1, k: -1, ...(inside && { ArrowDown: 1, ArrowUp: -1, Home: -1e9, End: 1e9 }) }[event.key];
    if (!move || !listed.length) return;
    event.preventDefault();
    choose(chosen + move, true);
    if (!inside) at("status").scrollIntoView({ block: "start" });
  });

  update();
})();
