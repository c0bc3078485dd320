
eyechart.browser = ({ update, show, empty, sideways }) => {
  const { at, make } = eyechart;
  const list = at("list");
  const detail = at("detail");
  let listed = [];
  let chosen = 0;

  const fill = (entries, place, words) => {
    listed = entries;
    chosen = place;
    list.replaceChildren(...entries.map((entry, number) => {
      const item = make("li");
      const button = make("button", "", "", { type: "button", tabindex: -1 });
      button.append(...words(entry));
      button.addEventListener("click", () => choose(number, true));
      item.append(button);
      return item;
    }));
    choose(chosen, false);
  };

  const choose = (place, focus) => {
    const buttons = list.querySelectorAll("button");
    if (!buttons.length) {
      detail.replaceChildren(make("p", "empty", empty));
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

  at("filters").addEventListener("input", update);
  at("filters").addEventListener("submit", (event) => event.preventDefault());

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
      at("f-text").focus();
      return;
    }
    const inside = list.contains(event.target);
    const step = { j: 1, k: -1, ...(inside && { ArrowDown: 1, ArrowUp: -1, Home: -1e9, End: 1e9 }), ...(inside && sideways && { ArrowRight: 1, ArrowLeft: -1 }) }[event.key];
    if (!step || !listed.length) return;
    event.preventDefault();
    choose(chosen + step, true);
    if (!inside) at("status").scrollIntoView({ block: "start" });
  });

  return { fill, chosen: () => listed[chosen] };
};
