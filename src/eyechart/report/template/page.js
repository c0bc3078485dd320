eyechart.begin("frames", "status", () => {
  const { data, at, make, options } = eyechart;
  const CUT = 1500;
  const filters = ["text", "run", "model", "scenario", "condition", "decision", "differs"];
  const field = Object.fromEntries(filters.map((name) => [name, at(`f-${name}`)]));
  const named = (names) => [["", "all"], ...names.map((name) => [name, name])];
  options(field.run, data.runs.map((run, place) => [String(place), run.name]));
  at("l-run").hidden = data.runs.length < 2;

  let run = null;
  const openRun = () => {
    run = data.runs[Number(field.run.value)];
    if (!run) return;
    options(field.model, [...run.models.map((model, place) => [String(place), model.name]), ...(run.models.length > 1 ? [["", "all"]] : [])]);
    options(field.scenario, named([...new Set(run.frames.map((frame) => frame.scenario))]));
    options(field.condition, named(run.conditions.map((condition) => condition.name)));
    const missing = new Set();
    for (const model of run.models) for (const calls of Object.values(model.calls)) for (const call of calls) if (call && !call[2]) missing.add(call[1]);
    options(field.decision, [["", "all"], ...run.actions.map((name) => [`a ${name}`, name]), ...[...missing].sort().map((name) => [`m ${name}`, `(${name})`])]);
  };

  const symbol = (call) => (call[2] ? `a ${call[1]}` : "m");
  const against = (model, frame, call) => {
    const real = model.calls.real && model.calls.real[frame];
    return real ? (symbol(real) === symbol(call) ? "same" : "differs") : "";
  };
  const matches = (frame) => {
    const words = field.text.value.toLowerCase();
    const about = run.frames[frame];
    const named = words === "" || [about.id, about.scenario, about.episode, ...about.truth.map((pair) => pair.join(" ")), ...(about.said || []).map((pair) => pair.join(" "))].some((text) => text.toLowerCase().includes(words));
    if (field.scenario.value && about.scenario !== field.scenario.value) return [];
    const found = [];
    for (const { name } of run.conditions) {
      if (field.condition.value && name !== field.condition.value) continue;
      run.models.forEach((model, place) => {
        if (field.model.value !== "" && String(place) !== field.model.value) return;
        const call = model.calls[name] && model.calls[name][frame];
        if (!call) return;
        if (field.decision.value && (call[2] ? `a ${call[1]}` : `m ${call[1]}`) !== field.decision.value) return;
        if (field.differs.value && (name === "real" || against(model, frame, call) !== field.differs.value)) return;
        if (!named && !data.texts[call[0]].toLowerCase().includes(words)) return;
        found.push([name, model, call]);
      });
    }
    return found;
  };

  const update = () => {
    if (!run) {
      at("status").textContent = "The run holds no frames.";
      return;
    }
    const before = shown.chosen();
    const listed = run.frames.map((_, frame) => [frame, matches(frame)]).filter(([, found]) => found.length);
    const calls = listed.reduce((sum, [, found]) => sum + found.length, 0);
    at("status").textContent = `${listed.length} of ${run.frames.length} frames, ${calls} calls match.` + (run.asked > run.frames.length ? ` This page lists ${run.frames.length} of ${run.asked} frames.` : "");
    shown.fill(listed, Math.max(0, before ? listed.findIndex(([frame]) => frame === before[0]) : 0), ([frame, found]) => {
      const count = make("span", "n", `${found.length}`);
      count.append(make("span", "unseen", " calls match"));
      return [make("span", "", run.frames[frame].id), " ", count];
    });
  };

  const show = ([frame, found]) => {
    const about = run.frames[frame];
    const truth = make("p", "truth", `${about.scenario}, episode ${about.episode}, step ${about.step}`);
    tell(truth, about.truth);
    const said = make("p", "truth");
    if (about.said) {
      said.append("The prompt says");
      tell(said, about.said);
    }
    const calls = make("div", "calls");
    for (const condition of run.conditions) {
      const mine = found.filter(([name]) => name === condition.name);
      if (mine.length) calls.append(card(frame, condition, mine));
    }
    at("detail").replaceChildren(make("h3", "", about.id), truth, ...(about.said ? [said] : []), calls);
  };

  const tell = (node, pairs) => {
    for (const [name, value] of pairs) node.append(` · ${name} `, make("b", "", value));
  };

  const card = (frame, condition, mine) => {
    const node = make("article", "call");
    node.append(make("h4", "", condition.name), make("p", "asks", `${condition.image}: ${condition.asks}`));
    const picture = run.pictures[condition.name][frame];
    if (picture >= 0) {
      const alt = `${run.frames[frame].id} under ${condition.name}`;
      node.append(make("img", "", "", { alt, decoding: "async", src: data.pictures[picture] }));
    } else {
      node.append(make("div", "missing", picture === -1 ? "no picture is sent" : "picture not in this page"));
    }
    const told = run.frames[frame].told && run.frames[frame].told[condition.name];
    if (told) {
      const said = make("p", "truth told");
      said.append("The prompt says of ", make("b", "", told[0]));
      tell(said, told[1]);
      node.append(said);
    }
    for (const [name, model, call] of mine) node.append(answer(frame, name, model, call));
    return node;
  };

  const answer = (frame, condition, model, call) => {
    const node = make("div", "answer");
    const who = make("div", "who");
    who.append(make("bdi", "", model.name));
    const line = make("div", "verdictline");
    const role = call[2] ? run.roles[call[1]] || "" : "none";
    line.append(make("span", `chip ${role}`, call[2] ? `${eyechart.sign(role)} ${call[1]}` : `no decision: ${call[1]}`));
    const compared = condition === "real" ? "" : against(model, frame, call);
    if (compared) {
      const real = model.calls.real[frame];
      line.append(make("span", `against ${compared}`, compared === "same" ? "= as real" : `≠ real: ${real[2] ? real[1] : `(${real[1]})`}`));
    }
    node.append(who, line, reply(call[0], `${model.name} on ${run.frames[frame].id} under ${condition}`));
    if (call.length > 3) node.append(make("p", "note", data.notes[call[3]]));
    return node;
  };

  const reply = (number, label) => {
    const text = data.texts[number];
    const whole = data.cut[number];
    const node = make("div");
    const said = { dir: "auto", tabindex: 0, role: "group", "aria-label": `Reply of ${label}` };
    const words = make("pre", "reply", text.slice(0, CUT), said);
    node.append(words);
    if (text === "") words.append(make("em", "", "(empty reply)"));
    if (whole) node.append(make("p", "note", `This page holds ${text.length.toLocaleString("en")} of ${whole.toLocaleString("en")} characters; the ledger has all of them.`));
    if (text.length > CUT) {
      words.append("…");
      const more = make("button", "quiet", `show all ${text.length.toLocaleString("en")} characters`, { type: "button" });
      more.addEventListener("click", () => {
        words.textContent = text;
        words.focus();
        more.remove();
      });
      node.append(more);
    }
    return node;
  };

  at("f-clear").addEventListener("click", () => {
    for (const name of filters) if (name !== "run") field[name].value = name === "model" && field.model.options.length ? field.model.options[0].value : "";
    update();
  });

  const shown = eyechart.browser({ update, show, empty: "No call matches these filters.", sideways: true });
  field.run.addEventListener("input", openRun);
  openRun();
  update();
});
