// A torqued server for this test, with two models whose training is shortened.

import { spawn } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";

const torqued = process.env.TORQUED ?? "target/release/torqued";

const spec = {
  preset: "two-models",
  jobs: {
    "train-set": { trajectories: 2048, shard_trajectories: 1024 },
    train: { steps: 20, optimizer: { warmup_steps: 0 } },
  },
};

/** A URDF of six joints, with names that are longer than a column. */
function urdf() {
  const inertial = `<inertial><origin xyz="0 0 0.1"/><mass value="0.8"/>
    <inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>`;
  let text = `<robot name="chain"><link name="foot"/>`;
  let before = "foot";
  for (let joint = 1; joint <= 6; joint++) {
    const link = `left_arm_link_number_${joint}_with_its_cover`;
    text += `<link name="${link}">${inertial}</link><joint name="left_arm_joint_number_${joint}" type="revolute">
      <parent link="${before}"/><child link="${link}"/><origin xyz="0 0 0.2"/>
      <axis xyz="${joint % 2 ? "0 1 0" : "1 0 0"}"/><limit lower="-2.5" upper="2.5" effort="40"/></joint>`;
    before = link;
  }
  return `${text}</robot>`;
}

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

  const robot = await fetch(`${url}/v1/robots?name=An%20arm%20with%20long%20names`, {
    method: "POST",
    headers: { "content-type": "application/xml" },
    body: urdf(),
  });
  const submitted = await fetch(`${url}/v1/jobs`, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(spec),
  });
  const { id } = await submitted.json();
  for (;;) {
    const job = await get(`/v1/jobs/${id}`);
    if (job.state === "succeeded") return { url, get, stop, pipeline: job, robot: await robot.json() };
    if (["failed", "cancelled"].includes(job.state)) {
      await stop();
      throw new Error(JSON.stringify(job));
    }
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
}
