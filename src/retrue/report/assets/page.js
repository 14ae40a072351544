"use strict";
// Draws the figures in the colors of the page, switches tabs, and gets everything ready for paper.

const TALLEST = 600; // pixels: a drawing should fit on a screen with its caption
const PAPER = { picture: 500, chart: 680 }; // pixels: two photographs to a sheet
const plots = [];

async function unpackPlotly() {
  const holder = document.getElementById("plotly");
  const packed = Uint8Array.from(atob(holder.textContent), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
  holder.remove();
}

// A figure with every "var(--name)" replaced by the color that it has now.
function colored(value, style) {
  if (typeof value === "string" && value.startsWith("var(")) return style.getPropertyValue(value.slice(4, -1)).trim();
  if (Array.isArray(value)) return typeof value[0] === "number" ? value : value.map((item) => colored(item, style));
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, colored(item, style)]));
}

function theme(style) {
  const ink = style.getPropertyValue("--ink").trim();
  const muted = style.getPropertyValue("--muted").trim();
  const line = style.getPropertyValue("--line").trim();
  const card = style.getPropertyValue("--card").trim();
  const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, tickfont: { color: muted }, title: { font: { color: muted, size: 12 } }, automargin: true };
  return {
    layout: {
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: ink },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      margin: { l: 48, r: 12, t: 12, b: 44 },
      hoverlabel: { bgcolor: card, bordercolor: line, font: { color: ink, family: getComputedStyle(document.body).fontFamily }, align: "left" },
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", font: { color: ink }, bgcolor: "rgba(0,0,0,0)" },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: muted, activecolor: ink },
      coloraxis: { colorbar: { outlinewidth: 0, tickfont: { color: muted }, title: { font: { color: muted } } } },
      xaxis: axis,
      yaxis: axis,
    },
  };
}

function sized(plot, width) {
  const narrow = width < 560;
  const wanted = Math.min(width * plot.aspect, TALLEST) + plot.extra;
  const height = Math.round(wanted);
  const style = getComputedStyle(document.documentElement);
  const figure = colored(plot.figure, style);
  const layout = { ...figure.layout, template: theme(style), width, height, autosize: false };
  if (narrow) figure.data.forEach(shrinkMarkers);
  return { data: figure.data, layout };
}

function shrinkMarkers(trace) {
  if (trace.type === "scatter" && typeof trace.marker.size === "number") trace.marker.size *= 0.6;
}

function draw(plot, width = plot.element.clientWidth) {
  const { data, layout } = sized(plot, width);
  const config = { displaylogo: false, displayModeBar: false };
  plot.width = width;
  return Plotly.react(plot.element, data, layout, config);
}

function readPlots() {
  for (const element of document.querySelectorAll(".plot")) {
    const source = element.nextElementSibling;
    const plot = { element, figure: JSON.parse(source.textContent), aspect: Number(element.dataset.aspect), extra: Number(element.dataset.extra) };
    source.remove();
    plots.push(plot);
  }
}

function show(tab) {
  const list = tab.closest(".tabs");
  for (const other of list.querySelectorAll('[role="tab"]')) {
    const chosen = other === tab;
    other.setAttribute("aria-selected", String(chosen));
    other.tabIndex = chosen ? 0 : -1;
    document.getElementById(other.getAttribute("aria-controls")).classList.toggle("shown", chosen);
  }
}

function listenToTabs() {
  for (const tab of document.querySelectorAll('[role="tab"]')) {
    tab.addEventListener("click", () => show(tab));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const all = [...tab.parentElement.children];
      const next = all[(all.indexOf(tab) + step + all.length) % all.length];
      next.focus();
      show(next);
    });
  }
}

function explain(error) {
  for (const { element } of plots) element.textContent = `This browser cannot show the drawing: ${error.message}`;
}

async function start() {
  listenToTabs();
  readPlots();
  try {
    await unpackPlotly();
  } catch (error) {
    explain(error);
    return;
  }
  for (const plot of plots) await draw(plot);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => draw(plot)));
  addEventListener("resize", () => plots.filter((plot) => plot.element.clientWidth !== plot.width).forEach((plot) => draw(plot)));
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("paper");
    plots.forEach((plot) => draw(plot, plot.aspect > 0.5 ? PAPER.picture : PAPER.chart));
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("paper");
    plots.forEach((plot) => draw(plot));
  });
  document.documentElement.dataset.ready = "yes";
}

start();
