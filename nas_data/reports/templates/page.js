"use strict";
const night = matchMedia("(prefers-color-scheme: dark)");
// The house colours as they are told apart on a dark page.
const DARK = {
  "#000000": "#e4e7eb", "#777777": "#9aa4b2", "#999999": "#7d8794", "#0072b2": "#4ba3dd", "#e69f00": "#f0b429",
  "#009e73": "#2ec49a", "#cc79a7": "#dd93bd", "#d55e00": "#f0803c", "#56b4e9": "#8fd0f5", "#8c6d31": "#c09a52",
};

function recolour(value) {
  if (Array.isArray(value)) return value.map(recolour);
  if (value && typeof value === "object")
    return Object.fromEntries(Object.entries(value).map(([key, part]) => [key, recolour(part)]));
  const known = night.matches && typeof value === "string" && DARK[value.slice(0, 7).toLowerCase()];
  return known ? known + value.slice(7) : value;
}

function themed(layout, narrow) {
  const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(name).trim();
  const axis = { gridcolor: colour("--line"), linecolor: colour("--soft"), zeroline: false, automargin: true };
  const result = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "x unified", dragmode: narrow ? "pan" : "zoom",
    font: { family: getComputedStyle(document.body).fontFamily, size: narrow ? 11 : 13, color: colour("--ink") },
    margin: { l: 10, r: 10, t: 10, b: 10 }, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("--line"), activecolor: colour("--soft") },
    hoverlabel: { bgcolor: colour("--tint"), font: { color: colour("--ink") } }, ...recolour(layout),
  };
  for (const key of new Set(["xaxis", "yaxis", ...Object.keys(layout).filter((name) => /^[xy]axis/.test(name))]))
    result[key] = { ...axis, ...result[key] };
  return result;
}

function draw(place) {
  const { data, layout } = JSON.parse(place.nextElementSibling.textContent), narrow = innerWidth < 600;
  if (narrow) data.forEach((trace) => { trace.showscale = false; });
  const options = {
    responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "", displayModeBar: narrow ? false : "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d"],
  };
  return Plotly.react(place, recolour(data), themed(layout, narrow), options);
}

function number(text) {
  const found = text.replace(/[−–]/g, "-").replace(/,/g, "").match(/-?\d+(\.\d+)?(e-?\d+)?/);
  return found ? Number(found[0]) : NaN;
}

function sort(header) {
  const table = header.closest("table"), column = header.cellIndex, body = table.tBodies[0];
  const rising = header.getAttribute("aria-sort") !== "ascending";
  for (const other of header.parentNode.cells) other.removeAttribute("aria-sort");
  header.setAttribute("aria-sort", rising ? "ascending" : "descending");
  const rows = [...body.rows].map((row) => [row, row.cells[column].textContent.trim()]);
  const words = column === 0 || rows.every(([, text]) => isNaN(number(text)));
  const compare = (a, b) => {
    if (words) return a.localeCompare(b, "en", { numeric: true }) * (rising ? 1 : -1);
    const one = number(a), other = number(b);
    return isNaN(one) || isNaN(other) ? isNaN(one) - isNaN(other) : (one - other) * (rising ? 1 : -1);
  };
  rows.sort(([, a], [, b]) => compare(a, b)).forEach(([row]) => body.append(row));
}

async function copy(button) {
  const pre = button.closest("details").querySelector("pre");
  try {
    await navigator.clipboard.writeText(pre.textContent);
  } catch {
    getSelection().selectAllChildren(pre);
    document.execCommand("copy");
  }
  button.textContent = "Copied";
}

document.querySelectorAll(".sorted thead th").forEach((header) => {
  header.addEventListener("click", () => sort(header));
  header.addEventListener("keydown", (event) => event.key === "Enter" && sort(header));
});
document.querySelectorAll(".copy").forEach((button) =>
  button.addEventListener("click", (event) => { event.preventDefault(); copy(button); }));
const charts = [...document.querySelectorAll(".chart")];
Promise.all(charts.map(draw)).then(() => { document.body.dataset.drawn = charts.length; });
night.addEventListener("change", () => charts.forEach(draw));
