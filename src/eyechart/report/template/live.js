"use strict";
(() => {
  const begun = Date.now();
  const at = (id) => document.getElementById(id);
  const goesOn = at("state").textContent;
  const wait = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
  let over = false;
  let lost = null;

  const show = (text) => {
    const page = new DOMParser().parseFromString(text, "text/html");
    const fresh = page.getElementById("now");
    if (!fresh) throw new Error("this is not the page of a run");
    at("now").replaceWith(document.adoptNode(fresh));
    return fresh.dataset.over;
  };

  const ask = async (path) => {
    try {
      const reply = await fetch(path, { cache: "no-store" });
      if (reply.status === 204) return;
      if (!reply.ok) throw new Error(`status ${reply.status}`);
      const said = show(await reply.text());
      over = over || Boolean(said);
      lost = null;
      if (over && said) at("state").textContent = `${said} This is how it stood.`;
      else if (!over) at("state").textContent = goesOn;
    } catch {
      if (over) return;
      lost = lost || new Date().toLocaleTimeString();
      at("state").textContent = `The connection was lost at ${lost}; this page tries again. It cannot say whether the run goes on: below is what was last seen.`;
    }
  };

  const look = async () => {
    while (!over) {
      const waiting = !lost && Date.now() - begun < 20000 && !document.querySelector("#now td");
      await wait(waiting ? 1000 : 5000);
      if (!over) await ask(".");
    }
  };
  const end = async () => {
    while (!over) {
      await ask("over");
      if (!over) await wait(lost ? 5000 : 100);
    }
  };
  look();
  end();
})();
