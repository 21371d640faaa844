"use strict";
// Panes of the chosen cloud, and tables that sort.
(() => {
  const { heat, scenes } = JSON.parse(document.getElementById("data").textContent);
  const viewer = new Viewer(heat);
  const holder = document.getElementById("panes"), chosen = document.getElementById("scene");
  document.getElementById("no-webgl").hidden = viewer.works;
  const REASONS = {
    surface: "no surface", normals: "this method has no normals",
    flipped: "no normals, or the truth is not known",
  };

  const add = (parent, kind, properties = {}) =>
    parent.appendChild(Object.assign(document.createElement(kind), properties));

  const build = scene => {
    holder.replaceChildren();
    const elements = scene.panes.map(pane => {
      const figure = add(holder, "figure", { className: `pane ${pane.method}` });
      const view = add(figure, "div", { className: "view" });
      if (!pane.error) {
        view.tabIndex = 0;
        view.setAttribute("role", "img");
        view.setAttribute("aria-label", `${pane.title}: ${scene.title}`);
        add(view, "img", { alt: `${pane.title}: ${scene.title}`, draggable: false });
        if (viewer.works) add(view, "canvas");
      }
      add(view, "p", { className: pane.error ? "failed" : "", textContent: pane.error ? `failed: ${pane.error}` : "" });
      const caption = add(figure, "figcaption");
      add(caption, "b", { textContent: pane.title });
      add(caption, "span", { textContent: pane.facts ?? "" });
      return view;
    });
    const whole = scene.panes.map((pane, k) => [pane, elements[k]]).filter(([pane]) => !pane.error);
    if (viewer.works) {
      viewer.show({ ...scene, panes: whole.map(([pane]) => pane) }, whole.map(([, element]) => element));
    }
    choose();
  };

  const choose = () => {
    const mode = document.querySelector("#mode input:checked").value, scene = scenes[chosen.selectedIndex];
    for (const key of document.querySelectorAll(".key")) key.hidden = !key.classList.contains(mode);
    scene.panes.forEach((pane, k) => {
      if (pane.error) return;
      const view = holder.children[k].querySelector(".view"), picture = pane.pictures[mode];
      const image = view.querySelector("img");
      image.hidden = viewer.works || !picture;
      if (!image.hidden) image.src = picture;
      view.querySelector("p").textContent = picture ? "" : REASONS[mode];
    });
    viewer.mode = mode;
    if (viewer.works) viewer.redraw();
  };

  for (const scene of scenes) add(chosen, "option", { textContent: scene.title });
  if (scenes.length) build(scenes[0]);
  chosen.addEventListener("change", () => build(scenes[chosen.selectedIndex]));
  document.getElementById("mode").addEventListener("change", choose);
  document.getElementById("reset").addEventListener("click", () => viewer.reset());

  for (const button of document.querySelectorAll("th button")) {
    button.addEventListener("click", () => {
      const head = button.closest("th"), table = head.closest("table");
      const column = [...head.parentNode.children].indexOf(head);
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of table.querySelectorAll("th")) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const value = row => row.children[column]?.dataset.value ?? "";
      const rows = [...table.tBodies[0].rows];
      rows.sort((a, b) => {
        const x = value(a), y = value(b);
        if (x === "" || y === "") return (x === "") - (y === "");
        const order = isNaN(x) || isNaN(y) ? x.localeCompare(y) : x - y;
        return down ? -order : order;
      });
      table.tBodies[0].append(...rows);
    });
  }
})();
