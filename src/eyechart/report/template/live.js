"use strict";
(() => {
  const begun = Date.now();
  const pause = () => (Date.now() - begun < 20000 ? 1000 : 5000);
  const look = async () => {
    try {
      const text = await (await fetch("/", { cache: "no-store" })).text();
      const fresh = new DOMParser().parseFromString(text, "text/html").getElementById("now");
      document.getElementById("now").replaceWith(document.adoptNode(fresh));
    } catch {
      document.getElementById("state").textContent = "The run is over, or was interrupted: this is how it stood.";
      return;
    }
    setTimeout(look, pause());
  };
  setTimeout(look, pause());
})();
