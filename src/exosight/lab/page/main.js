// Tabs, theme and the three parts of the page.

import { about } from "./api.js";
import { estimate } from "./estimate.js";
import { explore } from "./explore.js";
import { loop } from "./loop.js";
import { by } from "./svg.js";

const tabs = [...document.querySelectorAll('[role="tab"]')];

function choose(tab, focus = true) {
  for (const each of tabs) {
    const chosen = each === tab;
    each.setAttribute("aria-selected", String(chosen));
    each.tabIndex = chosen ? 0 : -1;
    by(each.getAttribute("aria-controls")).hidden = !chosen;
  }
  if (focus) tab.focus();
  document.dispatchEvent(new CustomEvent("tab", { detail: tab.getAttribute("aria-controls") }));
}

tabs.forEach((tab, i) => {
  tab.addEventListener("click", () => choose(tab));
  tab.addEventListener("keydown", (event) => {
    const to = { ArrowRight: i + 1, ArrowLeft: i - 1, Home: 0, End: tabs.length - 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    choose(tabs[(to + tabs.length) % tabs.length]);
  });
});

const THEMES = ["auto", "light", "dark"];

function theme(name) {
  if (name === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = name;
  by("theme").textContent = `Theme: ${name}`;
}

let chosen = "auto";
try { chosen = localStorage.getItem("theme") ?? "auto"; } catch { /* storage is off: auto */ }
theme(THEMES.includes(chosen) ? chosen : "auto");
by("theme").addEventListener("click", () => {
  chosen = THEMES[(THEMES.indexOf(chosen) + 1) % THEMES.length];
  try { localStorage.setItem("theme", chosen); } catch { /* it holds until the page is closed */ }
  theme(chosen);
});

function problem(sentence = "") {
  by("problem").hidden = !sentence;
  if (sentence && by("problem").textContent !== sentence) by("problem").textContent = sentence;
}

try {
  const known = await about();
  const { view, seen } = explore(known, problem);
  loop(known, view, seen, problem);
  estimate(known.network);
} catch (error) {
  by("status").hidden = true;
  problem(error.message);
}
