// Keeps the page current: after an event of the server, fetches the page again and replaces the parts that changed.
// Everything works without this script; reloading does the same. Without events, the page is fetched at intervals.

import { asSent } from "./charts.js";
import { LoggedOut, fetched, replace } from "./replace.js";
import { asWritten, localize } from "./times.js";

const SHORTEST_WAIT = 1500;
const LONGEST_WAIT = 30000;

// The kinds of events after which something may have changed; `end` comes after the last of a job.
const KINDS = ["job", "task", "metrics", "checkpoint", "deletion", "progress", "gap", "end"];

// Lists show the progress of tasks, robots, and runs of MLflow's clients, for which there is no event.
const LIST_WAIT = 10000;

const status = document.getElementById("liveness");
let wait = SHORTEST_WAIT;
let timer;
let refreshedAt = 0;
let isRefreshing = false;
let hasHappened = false;

// The stream of events, while there is one.
let events;
let isRefused = false;

function update(page) {
  let changed = false;
  for (const stale of document.querySelectorAll("[data-live]")) {
    const fresh = page.getElementById(stale.id);
    if (!fresh || fresh.isEqualNode(stale)) continue;
    // `open` is the reader's and does not count as a change, nor do figures that answer.
    const comparable = asSent(stale);
    asWritten(comparable);
    for (const details of comparable.querySelectorAll("details[open]")) {
      details.removeAttribute("open");
    }
    if (fresh.isEqualNode(comparable)) continue;
    replace(stale, fresh);
    changed = true;
  }
  return changed;
}

const isSettled = () => document.querySelector("[data-settled]") !== null;
const isLost = () => status.classList.contains("lost");
const isSettledForGood = () => document.querySelector("[data-settled='for-good']") !== null;

async function refresh() {
  clearTimeout(timer);
  const wasLost = isLost();
  [isRefreshing, hasHappened, refreshedAt] = [true, false, Date.now()];
  try {
    const changed = update(await fetched(location.href));
    status.className = "liveness";
    // A proxy refuses the stream of a server that is away; the one that is back has it again.
    if (wasLost) isRefused = false;
    status.textContent = isSettled() ? "" : "live";
    if (isSettled()) wait = LONGEST_WAIT;
    else wait = changed ? SHORTEST_WAIT : Math.min(wait * 1.5, LONGEST_WAIT / 3);
  } catch (error) {
    wait = Math.min(wait * 2, LONGEST_WAIT);
    [hasHappened, refreshedAt] = [true, Date.now()];
    status.className = "liveness lost";
    if (error instanceof LoggedOut) sayLoggedOut(error.address);
    else status.textContent = `no answer; next try in ${Math.round(wait / 1000)} s`;
  }
  isRefreshing = false;
  listen();
  schedule();
}

// The page stays as it was. A login in another tab brings it back to life, too.
function sayLoggedOut(address) {
  const link = document.createElement("a");
  link.href = address;
  link.textContent = "Log in";
  status.replaceChildren("your login has expired. ", link);
}

// Schedules the next fetch of the page: soon after an event, and at intervals without events.
function schedule() {
  clearTimeout(timer);
  if (document.hidden || isRefreshing) return;
  if (isSettledForGood()) {
    close();
    return;
  }
  const isList = events?.url.endsWith("/v1/events") ?? false;
  // An event must not put the next try off: the stream of a server that is back has many.
  if (isLost()) timer = setTimeout(refresh, refreshedAt + wait - Date.now());
  else if (hasHappened) timer = setTimeout(refresh, refreshedAt + SHORTEST_WAIT - Date.now());
  else if (!events) timer = setTimeout(refresh, wait);
  else if (isList && !isSettled()) timer = setTimeout(refresh, LIST_WAIT);
}

function listen() {
  const path = document.querySelector("[data-events]")?.dataset.events;
  if (!path || events || isRefused || document.hidden || isSettledForGood()) return;
  events = new EventSource(path);
  const tell = () => {
    hasHappened = true;
    schedule();
  };
  events.addEventListener("open", () => {
    // The server is there, so the next try need not wait for long.
    wait = SHORTEST_WAIT;
    // Something may have happened before.
    tell();
  });
  for (const kind of KINDS) events.addEventListener(kind, tell);
  events.addEventListener("end", close);
  events.addEventListener("error", () => {
    if (events?.readyState === EventSource.CLOSED) {
      // It was refused, and the browser does not try again.
      isRefused = true;
      close();
    }
    // The page says whether the server is there.
    tell();
  });
}

function close() {
  events?.close();
  events = undefined;
}

// A browser allows few connections to one server, so hidden pages close theirs.
function seeOrHide() {
  wait = SHORTEST_WAIT;
  if (document.hidden) {
    close();
  } else {
    isRefused = false;
    listen();
  }
  schedule();
}

// MLflow's clients print addresses of this form.
const logged = location.hash.match(/^#\/experiments\/\d+\/runs\/([0-9a-z-]+)/);
if (logged) location.replace(`/logged/${logged[1]}`);

localize(document);
// On a narrow screen, the box that the page is about may be far to the right.
for (const box of document.querySelectorAll(".lineage .here rect")) {
  const region = box.closest(".lineage");
  region.scrollLeft = box.x.baseVal.value + (box.width.baseVal.value - region.clientWidth) / 2;
}
if (document.querySelector("[data-live]")) {
  document.addEventListener("visibilitychange", seeOrHide);
  listen();
  schedule();
}
