// Draws the figures in the page's colours and for its width, and again when those change; folded ones when they are opened.
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)"), narrow = matchMedia("screen and (max-width: 620px)");
  const axis = {gridcolor: "var(--line)", zerolinecolor: "var(--line)", linecolor: "var(--steel)", showline: true};
  const look = JSON.stringify({layout: {
    font: {family: "system-ui, 'Segoe UI', Helvetica, Arial, sans-serif", size: 12, color: "var(--soft)"},
    paper_bgcolor: "var(--paper)", plot_bgcolor: "var(--paper)", xaxis: axis, yaxis: axis,
    hoverlabel: {bgcolor: "var(--paper)", bordercolor: "var(--line)", font: {color: "var(--ink)"}},
    legend: {orientation: "h", x: 0, y: 1, xref: "container", yref: "container", yanchor: "top"},
  }});
  const draw = (place, more) => {
    const style = getComputedStyle(document.documentElement);
    const coloured = (json) => JSON.parse(json.replace(/var\((--[\w-]+)\)/g, (_, name) => style.getPropertyValue(name).trim()));
    const figure = coloured(place.querySelector("script").textContent), template = coloured(look);
    const layout = narrow.matches && figure.phone || figure.desk;
    for (const trace of figure.data)
      if (Number.isInteger(trace.x)) trace.x = {dtype: "f4", bdata: figure.shared[trace.x]};
    const drawn = place.querySelector("div");
    drawn.style.minHeight = `${layout.height}px`;
    Plotly.react(drawn, figure.data, {...layout, template, ...more}, {displayModeBar: false, responsive: true});
    if (figure.data.some((trace) => trace.customdata)) {
      drawn.removeAllListeners("plotly_click");
      drawn.on("plotly_click", opens);
    }
  };
  const opens = (event) => {
    const page = event.points[0].customdata;
    if (page) location.assign(page);
  };
  const all = (inside, more) => {
    for (const place of inside.querySelectorAll(".plot"))
      if (place.clientWidth) draw(place, more && {width: place.clientWidth < 600 ? 330 : 680, autosize: false});
  };
  all(document);
  for (const query of [dark, narrow]) query.addEventListener("change", () => all(document));
  document.addEventListener("toggle", (event) => all(event.target), true);
  addEventListener("beforeprint", () => {
    for (const folded of document.querySelectorAll("details")) folded.open = true;
    all(document, true);
  });
  addEventListener("afterprint", () => all(document));
})();
