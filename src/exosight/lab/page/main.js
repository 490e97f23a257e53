// Tabs, theme and the three parts of the page.

import { about } from "./api.js";
import { readAddress, writeAddress } from "./address.js";
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
  document.dispatchEvent(new CustomEvent("changed"));
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

// Its own address would take the place of the settings'.
document.querySelector(".skip").addEventListener("click", (event) => { event.preventDefault(); by("main").focus(); });

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

const SETTLED = 300;  // ms without a change until the address follows; browsers refuse a hundred in 30 s

/** Keep the settings in the address, one entry of the browser's history for each change that settles. */
function remember(known, { apply, state }) {
  const opening = writeAddress(readAddress("", known), known);
  let pending = 0, entered = false;  // entered: what changes now comes from the address

  function take(text) {
    clearTimeout(pending);
    entered = true;
    try {
      apply(readAddress(text, known));
      stale();
    } catch (error) {
      fallBack(error.message);
    }
  }

  function stale(sentence = "") {
    by("stale").hidden = !sentence;
    by("stale").textContent = sentence;
  }

  function fallBack(reason) {
    entered = true;
    apply(readAddress("", known));
    stale(`The settings in the address do not fit, so the page starts with its own: ${reason}.`);
  }

  function save() {
    const text = writeAddress(state(), known);
    const address = location.pathname + (text === opening ? "" : text);
    if (entered) history.replaceState(null, "", address);
    else if (address !== location.pathname + location.hash) { history.pushState(null, "", address); stale(); }
    entered = false;
  }

  document.addEventListener("changed", () => { clearTimeout(pending); pending = setTimeout(save, SETTLED); });
  document.addEventListener("refused", (event) => fallBack(event.detail));
  addEventListener("popstate", () => take(location.hash));
  take(location.hash);
}

try {
  const known = await about();
  const first = explore(known, problem);
  const second = loop(known, first.view, first.seen, problem);
  estimate(known);
  const shownTab = () => tabs.find((tab) => tab.getAttribute("aria-selected") === "true").getAttribute("aria-controls");
  remember(known, {
    state: () => ({ tab: shownTab(), ...first.state(), run: second.chosen }),
    apply: ({ tab, run, ...settings }) => {
      first.apply(settings);
      second.apply(run);
      choose(by(`tab-${tab}`), false);
    },
  });
} catch (error) {
  by("status").hidden = true;
  problem(error.message);
}
