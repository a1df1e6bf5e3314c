// A server that asks for tokens, and one that goes and comes back.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";

import { launch, shifts } from "./chromium.mjs";

const torqued = process.env.TORQUED ?? "target/release/torqued";
const token = "a-token-of-this-test";

let browser;

before(async () => {
  browser = await launch();
});

after(() => browser?.close());

/** A server in a folder, by default without workers: its address, and how it ends. */
async function serve(folder, { listen = "127.0.0.1:0", workers = 0, env = {} } = {}) {
  const server = spawn(torqued, ["serve", "--workers", String(workers), "--data", folder, "--listen", listen], {
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

/** The page went on saying that it was live, and showed what was there when the login expired. */
test("a page says that its login has expired, and leads back after the next one", () =>
  withFolder(async (folder) => {
    const server = await serve(folder, { env: { TORQUED_TOKEN: token } });
    const page = await browser.newPage();
    const logIn = async () => {
      await page.getByLabel("Token").fill(token);
      await page.getByRole("button", { name: "Log in" }).click();
      await page.waitForURL(`${server.url}/runs`);
    };
    try {
      await page.goto(`${server.url}/runs`);
      await logIn();
      await page.context().clearCookies();
      const submitted = await fetch(`${server.url}/v1/jobs`, {
        method: "POST",
        headers: { "content-type": "application/json", authorization: `Bearer ${token}` },
        body: JSON.stringify({ preset: "D1-multisine", trajectories: 1 }),
      });
      assert.equal(submitted.status, 201, await submitted.clone().text());
      const said = page.locator("#liveness.lost");
      await said.filter({ hasText: "your login has expired" }).waitFor({ timeout: 30_000 });
      await said.getByRole("link", { name: "Log in" }).click();
      await logIn();
    } finally {
      await page.close();
      await server.stop();
    }
  }));

test("a run that a client of MLflow logs appears in the list of all runs, and its metrics on its page", () =>
  withFolder(async (folder) => {
    const server = await serve(folder);
    const page = await browser.newPage();
    const ask = async (operation, body) => {
      const answer = await fetch(`${server.url}/api/2.0/mlflow/runs/${operation}`, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify(body),
      });
      assert.equal(answer.status, 200, await answer.clone().text());
      return answer.json();
    };
    try {
      await page.goto(`${server.url}/logged`);
      const { run } = await ask("create", { experiment_id: "0", run_name: "came later", start_time: Date.now() });
      await page.getByRole("link", { name: "came later" }).click({ timeout: 30_000 });
      await page.waitForURL(/logged\/[0-9a-f]{32}$/);
      const metric = { key: "loss", value: 0.5, timestamp: Date.now(), step: 1 };
      await ask("log-metric", { run_id: run.info.run_id, ...metric });
      await page.getByRole("heading", { name: "Latest metrics" }).waitFor({ timeout: 30_000 });
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

/** Every event put the next try off, and a training has more than one in each wait. */
test("a page of a job that runs goes on when its server is back", () =>
  withFolder(async (folder) => {
    let server = await serve(folder, { workers: 1 });
    const { host } = new URL(server.url);
    const page = await browser.newPage();
    try {
      const submitted = await fetch(`${server.url}/v1/jobs`, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({
          kind: "train",
          data: { stream: { preset: "D1-multisine" } },
          model: { preset: "robomorph-tiny" },
          batch_size: 4,
          steps: 100_000,
          checkpoint_every_steps: 100,
        }),
      });
      assert.equal(submitted.status, 201, await submitted.clone().text());
      const { id, run } = await submitted.json();
      await page.goto(`${server.url}/runs/${run}`);
      await page.locator("#run .badge.running").waitFor({ timeout: 60_000 });
      await page.locator("#run progress").waitFor({ timeout: 60_000 });
      // A growing log pushed what is below it, with each event.
      await page.goto(`${server.url}/jobs/${id}`);
      await page.locator("#log pre").waitFor({ timeout: 30_000 });
      await page.waitForTimeout(6000);
      const moved = await page.evaluate(shifts);
      assert.ok(moved <= 0.1, `the page moved by ${moved}`);
      await page.goto(`${server.url}/runs/${run}`);
      await server.stop();
      await page.locator("#liveness.lost").waitFor({ timeout: 30_000 });
      server = await serve(folder, { listen: host, workers: 1 });
      await page.locator("#liveness.lost").waitFor({ state: "detached", timeout: 45_000 });
      // Cancelling asks first, and says what is lost.
      await page.getByRole("link", { name: "Cancel" }).click();
      await page.waitForURL(`**/jobs/${id}/cancel`);
      assert.match(await page.locator("main").innerText(), /A retry goes on from/);
      await page.getByRole("link", { name: "Let it go on" }).click();
      await page.getByRole("link", { name: "Cancel" }).click();
      await page.getByRole("button", { name: "Cancel this train job" }).click();
      await page.waitForURL(`**/jobs/${id}`);
      await page.locator("#job .badge.cancelled").first().waitFor({ timeout: 30_000 });
    } finally {
      await page.close();
      await server.stop();
    }
  }));

test("a token that may only read sees no button that it may not use, and is told why on a page", () =>
  withFolder(async (folder) => {
    const server = await serve(folder, { env: { TORQUED_TOKEN: token } });
    const page = await browser.newPage();
    const send = (path, body) => fetch(server.url + path, {
      method: "POST",
      headers: { "content-type": "application/json", authorization: `Bearer ${token}` },
      body: JSON.stringify(body),
    });
    try {
      const { secret } = await (await send("/v1/tokens", { name: "guest", scope: "read" })).json();
      const { id } = await (await send("/v1/jobs", { preset: "D1-multisine", trajectories: 1 })).json();
      await page.goto(`${server.url}/jobs/${id}`);
      await page.getByLabel("Token").fill(secret);
      await page.getByRole("button", { name: "Log in" }).click();
      await page.waitForURL(`${server.url}/jobs/${id}`);
      assert.equal(await page.getByRole("link", { name: "Cancel" }).count(), 0);
      await page.goto(`${server.url}/jobs/${id}/cancel`);
      assert.equal(await page.getByRole("button", { name: "Cancel" }).count(), 0);
      assert.equal(await page.getByRole("link", { name: "Launch" }).count(), 0);
      await page.goto(`${server.url}/launch?job=${id}`);
      assert.ok(await page.getByRole("button", { name: "Launch", exact: true }).isDisabled());
      // An older page still has its button.
      await page.evaluate(() => document.querySelectorAll("button").forEach((it) => (it.disabled = false)));
      await page.getByRole("button", { name: "Launch", exact: true }).click();
      await page.getByRole("heading", { name: "This token may only read" }).waitFor();
      await page.getByRole("link", { name: "Experiments", exact: true }).waitFor();
    } finally {
      await page.close();
      await server.stop();
    }
  }));
