"use strict";
const eyechart = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = (id) => document.getElementById(id);
  const set = (node, attributes) => {
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    return node;
  };
  const draw = (tag, attributes) => set(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes);
  const make = (tag, className, text, attributes = {}) => {
    const node = set(document.createElement(tag), attributes);
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

  const widths = new WeakMap();
  const fold = (entries) => {
    for (const { target, contentRect } of entries) {
      const table = target.querySelector("table");
      if (!contentRect.width || widths.get(target) === contentRect.width) continue;
      widths.set(target, contentRect.width);
      table.classList.remove("folded");
      if (target.scrollWidth <= target.clientWidth + 1) continue;
      const heads = [...table.tHead.rows[0].cells].map((one) => one.textContent);
      for (const row of table.tBodies[0].rows) for (const one of row.cells) one.dataset.head = heads[one.cellIndex];
      table.classList.add("folded");
    }
  };
  const folding = new ResizeObserver(fold);
  for (const one of document.querySelectorAll(".scroll:has(> table > thead)")) folding.observe(one);

  const options = (select, pairs) => {
    select.replaceChildren(...pairs.map(([value, text]) => make("option", "", text, { value })));
  };

  const unpack = async () => {
    const bytes = Uint8Array.from(atob(at("packed").textContent.trim()), (sign) => sign.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    Object.assign(data, JSON.parse(await new Response(stream).text()));
    at("packed").remove();
  };

  const begin = (place, told, start) => {
    if (!at("packed")) return start();
    at(told).textContent = "The replies of this large report are unpacked when they are looked at.";
    const near = new IntersectionObserver(async (seen) => {
      if (!seen.some((one) => one.isIntersecting)) return;
      near.disconnect();
      try {
        await unpack();
      } catch (error) {
        at(told).textContent = `This browser cannot unpack the replies (${error.message}); a newer one can.`;
        return;
      }
      start();
    }, { rootMargin: "600px" });
    near.observe(at(place));
  };

  const sign = (role) => ({ brake: "■", proceed: "▲" })[role] || "●";

  return { data, at, sign, set, draw, make, options, begin };
})();
