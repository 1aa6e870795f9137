// Draws the figures that can be zoomed, in the page's colours, and again when those change.
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)"), places = [...document.querySelectorAll(".plot")];
  const draw = (place) => {
    const style = getComputedStyle(document.documentElement);
    const text = place.querySelector("script").textContent.replace(/var\((--[\w-]+)\)/g, (_, name) => style.getPropertyValue(name).trim());
    const figure = JSON.parse(text);
    for (const trace of figure.data)
      if (Number.isInteger(trace.x)) trace.x = {dtype: "f4", bdata: figure.shared[trace.x]};
    Plotly.react(place.querySelector("div"), figure.data, figure.layout, {displayModeBar: false, responsive: true});
  };
  const fit = (width) => {
    for (const place of places) Plotly.relayout(place.querySelector("div"), width ? {width: width, autosize: false} : {width: null, autosize: true});
  };
  places.forEach(draw);
  dark.addEventListener("change", () => places.forEach(draw));
  addEventListener("beforeprint", () => { places.forEach(draw); fit(680); });
  addEventListener("afterprint", () => { places.forEach(draw); fit(null); });
})();
