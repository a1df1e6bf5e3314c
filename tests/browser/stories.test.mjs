// A server that asks for tokens, and one that goes and comes back.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";

import { launch } from "./chromium.mjs";

const torqued = process.env.TORQUED ?? "target/release/torqued";
const token = "a-token-of-this-test";

let browser;

before(async () => {
  browser = await launch();
});

after(() => browser?.close());

/** A server without workers in a folder: its address, and how it ends. */
async function serve(folder, { listen = "127.0.0.1:0", env = {} } = {}) {
  const server = spawn(torqued, ["serve", "--workers", "0", "--data", folder, "--listen", listen], {
    env: { ...process.env, ...env },
    stdio: ["ignore", "pipe", "inherit"],
  });
  const ended = new Promise((resolve) => server.once("exit", resolve));
  const lines = createInterface({ input: server.stdout });
  const line = await Promise.race([
    new Promise((resolve) => lines.once("line", resolve)),
    ended.then(() => Promise.reject(new Error("serve ended"))),
  ]);
  const url = line.split(" ").at(-1);
  const stop = async () => {
    server.kill("SIGTERM");
    await ended;
  };
  return { url, stop };
}

/** Does something with a folder that is deleted afterwards. */
async function withFolder(act) {
  const folder = await mkdtemp(join(tmpdir(), "torqued-story-"));
  try {
    await act(folder);
  } finally {
    await rm(folder, { recursive: true, force: true });
  }
}

test("a page behind a token asks for it, refuses a wrong one, and is shown after the right one until the log out", () =>
  withFolder(async (folder) => {
    const server = await serve(folder, { env: { TORQUED_TOKEN: token } });
    const page = await browser.newPage();
    try {
      await page.goto(`${server.url}/runs`);
      await page.getByLabel("Token").fill("a-token-that-is-wrong");
      await page.getByRole("button", { name: "Log in" }).click();
      assert.match(await page.getByRole("alert").innerText(), /not valid/);
      await page.getByLabel("Token").fill(token);
      await page.getByRole("button", { name: "Log in" }).click();
      await page.waitForURL(`${server.url}/runs`);
      assert.equal(await page.locator("h1").innerText(), "Runs");
      const cookies = await page.context().cookies();
      assert.ok(cookies.every((cookie) => cookie.httpOnly), "scripts cannot read the login");
      await page.getByRole("button", { name: "Log out" }).click();
      await page.goto(`${server.url}/runs`);
      await page.getByLabel("Token").waitFor();
    } finally {
      await page.close();
      await server.stop();
    }
  }));

test("a page says that its server has gone, and goes on when it is back", () =>
  withFolder(async (folder) => {
    let server = await serve(folder);
    const { host } = new URL(server.url);
    const page = await browser.newPage();
    try {
      await page.goto(server.url);
      await server.stop();
      await page.locator("#liveness.lost").waitFor({ timeout: 20_000 });
      server = await serve(folder, { listen: host });
      await fetch(`${server.url}/v1/jobs?name=after%20the%20break`, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ preset: "D1-multisine", trajectories: 1 }),
      });
      // Nobody executes it, so it stands among those that wait, which are folded.
      await page.getByText("after the break").first().waitFor({ state: "attached", timeout: 60_000 });
      assert.equal(await page.locator("#liveness.lost").count(), 0);
    } finally {
      await page.close();
      await server.stop();
    }
  }));
