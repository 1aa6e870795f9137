for (const place of document.querySelectorAll(".plot")) {
  const figure = JSON.parse(place.querySelector("script").textContent);
  Plotly.newPlot(place, figure.data, figure.layout, {displayModeBar: false, responsive: true});
}
const fit = (width) => {
  for (const place of document.querySelectorAll(".plot"))
    Plotly.relayout(place, width ? {width: width, autosize: false} : {width: null, autosize: true});
};
addEventListener("beforeprint", () => fit(680));
addEventListener("afterprint", () => fit(null));
