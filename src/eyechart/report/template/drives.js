(() => {
  const { data, at, set, draw, make, options, sign } = eyechart;
  const SIGNED = 24;
  const filters = ["text", "driver", "scenario", "condition", "ended", "pictures"];
  const field = Object.fromEntries(filters.map((name) => [name, at(`f-${name}`)]));
  for (const name of ["driver", "scenario", "condition", "ended"]) {
    const values = [...new Set(data.episodes.map((one) => one[name]))];
    options(field[name], [["", "all"], ...values.map((value) => [value, value])]);
  }

  const matches = (one) => {
    for (const name of ["driver", "scenario", "condition", "ended"]) if (field[name].value && one[name] !== field[name].value) return false;
    if (field.pictures.value && !one.pictures.length) return false;
    const words = field.text.value.toLowerCase();
    return words === "" || one.id.toLowerCase().includes(words) || one.steps.some((step) => step[5] >= 0 && data.texts[step[5]].toLowerCase().includes(words));
  };

  const update = () => {
    const before = shown.chosen();
    const listed = data.episodes.filter(matches);
    at("status").textContent = `${listed.length} of ${data.episodes.length} episodes match.`;
    shown.fill(listed, Math.max(0, listed.indexOf(before)), (one) => [make("span", "", one.run ? `${one.run} · ${one.id}` : one.id), " ", make("span", "n", one.ended)]);
  };

  const counted = (steps) => {
    const counts = new Map();
    for (const step of steps) counts.set(step[0], (counts.get(step[0]) || 0) + 1);
    return [...counts].sort((a, b) => b[1] - a[1]).map(([name, count]) => `${count} ${name}`).join(", ");
  };

  const role = (action) => data.roles[action] || "other";

  const gapLine = (steps) => {
    const svg = draw("svg", { class: "gaps", viewBox: "0 0 100 40", preserveAspectRatio: "none", role: "img" });
    const known = steps.map((step) => step[3]).filter((gap) => gap !== null);
    const far = Math.max(1, ...known);
    svg.setAttribute("aria-label", known.length ? `Gap by step, from ${Math.min(...known)} to ${Math.max(...known)} metres; broken where nothing is ahead` : "No gap at any step");
    let points = [];
    const flush = () => {
      if (points.length) {
        if (points.length === 1) points.push(points[0].replace(/^[\d.]+/, (x) => String(Number(x) + 0.6)));
        svg.append(draw("polyline", { points: points.join(" ") }));
      }
      points = [];
    };
    steps.forEach((step, place) => {
      if (step[3] === null) flush();
      else points.push(`${((place + 0.5) / steps.length * 100).toFixed(2)},${(38 - 36 * step[3] / far).toFixed(2)}`);
    });
    flush();
    const cursor = draw("line", { y1: 0, y2: 40 });
    svg.append(cursor);
    return [svg, cursor, known.length ? far : null];
  };

  const show = (one) => {
    const truth = make("p", "truth", `${one.simulator} · ${one.scenario} · seed ${one.seed} · shown ${one.condition} · ended ${one.ended}${one.detail ? `: ${one.detail}` : ""} · ${one.distance === null ? "—" : one.distance} m · reward ${one.reward}`);
    const told = make("p", "truth", `${one.steps.length} decisions: ${counted(one.steps) || "none"}`);
    const title = make("h3");
    title.append(make("bdi", "", one.id));
    if (!one.steps.length) {
      at("detail").replaceChildren(title, truth, told);
      return;
    }
    const strip = make("div", "strip", "", { "aria-hidden": true });
    const cells = one.steps.map((step) => make("span", `${role(step[1])}${step[2] ? "" : " none"}`, sign(role(step[1]))));
    strip.classList.toggle("many", cells.length > SIGNED);
    strip.append(...cells);
    const [svg, cursor, far] = gapLine(one.steps);
    const key = make("p", "key", `Strip: executed actions, ■ tall and dark brakes, ▲ low and pale proceeds, ● between is another, hatched is the fail-safe.${far === null ? "" : ` Line: gap, up to ${far} m.`}`);
    const label = make("label", "slider");
    label.append(make("span", "unseen", "Step"));
    const slider = make("input", "", "", { id: "step", type: "range", min: 0, max: one.steps.length - 1, value: 0 });
    label.append(slider);
    const image = make("img", "drivepicture", "", { decoding: "async" });
    const line = make("div", "verdictline");
    const words = make("p", "truth", "", { id: "moment" });
    const reply = make("pre", "reply", "", { dir: "auto", tabindex: 0, role: "group" });
    const step = () => {
      const now = Number(slider.value);
      const [decision, executed, own, gap, speed, text] = one.steps[now];
      cells.forEach((cell, place) => cell.classList.toggle("now", place === now));
      const x = ((now + 0.5) / cells.length * 100).toFixed(2);
      set(cursor, { x1: x, x2: x });
      const chip = make("span", `chip ${own ? role(decision) : "none"}`, own ? `${sign(role(decision))} ${decision}` : `no decision: ${decision}`);
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
    at("detail").replaceChildren(title, truth, told, ...(one.pictures.length ? [image] : []), strip, svg, label, key, line, words, reply);
    step();
  };

  at("f-clear").addEventListener("click", () => {
    for (const name of filters) field[name].value = "";
    update();
  });

  const shown = eyechart.browser({ update, show, empty: "No episode matches these filters.", sideways: false });
  update();
})();
