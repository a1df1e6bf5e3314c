// The browser that the tests drive, and what they ask its pages.

import { chromium } from "playwright-core";

export function launch() {
  return chromium.launch({
    executablePath: "/usr/bin/chromium",
    args: [
      "--no-sandbox",
      "--disable-gpu",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
    ],
  });
}

/** In a page: the layout shift so far, as a part of the window, without what followed a press. */
export function shifts() {
  return new Promise((resolve) => {
    let sum = 0;
    const observer = new PerformanceObserver((list) => {
      for (const shift of list.getEntries()) if (!shift.hadRecentInput) sum += shift.value;
    });
    observer.observe({ type: "layout-shift", buffered: true });
    // What is buffered is told at once.
    setTimeout(() => resolve(sum), 100);
  });
}
