// Draws the figures in the page's colours and for its width, and again when those change.
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)"), narrow = matchMedia("screen and (max-width: 620px)");
  const places = [...document.querySelectorAll(".plot")];
  const draw = (more) => {
    const style = getComputedStyle(document.documentElement);
    for (const place of places) {
      const text = place.querySelector("script").textContent.replace(/var\((--[\w-]+)\)/g, (_, name) => style.getPropertyValue(name).trim());
      const figure = JSON.parse(text), layout = narrow.matches ? figure.phone : figure.desk;
      for (const trace of figure.data)
        if (Number.isInteger(trace.x)) trace.x = {dtype: "f4", bdata: figure.shared[trace.x]};
      Plotly.react(place.querySelector("div"), figure.data, {...layout, ...more}, {displayModeBar: false, responsive: true});
    }
  };
  draw();
  for (const query of [dark, narrow]) query.addEventListener("change", () => draw());
  document.addEventListener("toggle", () => dispatchEvent(new Event("resize")), true);  // what was folded has no width
  addEventListener("beforeprint", () => {
    for (const folded of document.querySelectorAll("details")) folded.open = true;
    draw({width: 680, autosize: false});
  });
  addEventListener("afterprint", () => draw());
})();
