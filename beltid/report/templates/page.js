"use strict";
// The picture is replaced only if the surface can be drawn, which needs WebGL.
(function () {
  addEventListener("beforeprint", function () { // unfold everything on paper
    for (const folded of document.querySelectorAll("details")) folded.open = true;
  });
  const plot = document.getElementById("surface-plot");
  const canvas = document.createElement("canvas");
  if (!plot || !window.DecompressionStream) return;
  if (!(canvas.getContext("webgl2") || canvas.getContext("webgl"))) return;
  const data = JSON.parse(document.getElementById("surface-data").textContent);
  const figure = plot.closest("figure");
  const drawing = figure.querySelector(".drawing");
  plot.hidden = false;
  if (plot.clientWidth < 480) { // a narrow screen: move the camera away and hide the scale
    const eye = data.layout.scene.camera.eye;
    for (const axis of ["x", "y", "z"]) eye[axis] *= 1.35;
    for (const trace of data.data) trace.showscale = false;
  }
  const packed = atob(document.getElementById("library").textContent);
  const bytes = Uint8Array.from(packed, function (c) { return c.charCodeAt(0); });
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  new Response(unpacked).text().then(function (text) {
    const library = document.createElement("script");
    library.textContent = text; // allowed by its hash in the page's policy
    document.head.append(library);
    return Plotly.newPlot(plot, data.data, data.layout, data.config);
  }).then(function () {
    drawing.style.display = "none"; // print shows it again
    figure.querySelector(".only-live").hidden = false;
  }, function () {
    plot.hidden = true;
  });
})();
