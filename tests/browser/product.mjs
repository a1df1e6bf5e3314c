// A torqued server for this test, with a quickstart whose training is shortened.

import { spawn } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";

const torqued = process.env.TORQUED ?? "target/release/torqued";

const spec = {
  preset: "quickstart",
  jobs: {
    "train-set": { trajectories: 2048, shard_trajectories: 1024 },
    train: { steps: 20, optimizer: { warmup_steps: 0 } },
  },
};

/** Starts a server and waits until its pipeline succeeded. */
export async function start() {
  const folder = await mkdtemp(join(tmpdir(), "torqued-browser-"));
  const server = spawn(torqued, ["serve", "--data", folder, "--listen", "127.0.0.1:0"], {
    stdio: ["ignore", "pipe", "inherit"],
  });
  const lines = createInterface({ input: server.stdout });
  const [line] = await Promise.race([
    new Promise((resolve) => lines.once("line", (text) => resolve([text]))),
    new Promise((_, reject) => server.once("exit", () => reject(new Error("serve ended")))),
  ]);
  const url = line.split(" ").at(-1);
  const get = async (path) => (await fetch(url + path)).json();
  const stop = async () => {
    const ended = new Promise((resolve) => server.once("exit", resolve));
    server.kill("SIGTERM");
    await ended;
    await rm(folder, { recursive: true, force: true });
  };

  const submitted = await fetch(`${url}/v1/jobs`, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(spec),
  });
  const { id } = await submitted.json();
  for (;;) {
    const job = await get(`/v1/jobs/${id}`);
    if (job.state === "succeeded") return { url, get, stop, pipeline: job };
    if (["failed", "cancelled"].includes(job.state)) {
      await stop();
      throw new Error(JSON.stringify(job));
    }
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
}
