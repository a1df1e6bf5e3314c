// Graphile Worker with the roles of store/examples/queue_rates: `node queue.mjs ROLE FOLDER
// DATABASE ...`. Batches are those of https://worker.graphile.org/docs/performance: each process
// fetches tasks ahead of their execution.

import { createInterface } from "node:readline";
import { EventEmitter } from "node:events";
import { setTimeout as sleep } from "node:timers/promises";
import { Logger, run, runMigrations } from "graphile-worker";
import pg from "pg";

const LOCAL_QUEUE = 500;

const BATCH = 1000;

const [role, , connectionString, ...rest] = process.argv.slice(2);

// The present in microseconds since 1970.
const now = () => Math.round((performance.timeOrigin + performance.now()) * 1e3);

const add = (client, count) =>
  client.query(
    `SELECT graphile_worker.add_job('nothing', json_build_object('called_at_us', $1::bigint))
     FROM generate_series(1, $2::int)`,
    [now(), count],
  );

async function withClient(use) {
  const client = new pg.Client({ connectionString });
  await client.connect();
  await use(client);
  await client.end();
}

async function work(workers) {
  const waits = [];
  let completed = 0;
  const events = new EventEmitter();
  events.on("job:complete", () => completed++);
  const pool = new pg.Pool({ connectionString, max: workers + 2 });
  pool.on("error", (error) => console.error(error));
  pool.on("connect", (client) => client.on("error", (error) => console.error(error)));
  const connections = await Promise.all(Array.from({ length: workers }, () => pool.connect()));
  connections.forEach((connection) => connection.release());
  const begin = () =>
    run({
      pgPool: pool,
      events,
      noHandleSignals: true,
      // Its output is only for answers.
      logger: new Logger(() => (level, message) => level === "error" && console.error(message)),
      preset: {
        worker: {
          concurrentJobs: workers,
          pollInterval: 1000,
          localQueue: { size: LOCAL_QUEUE },
          completeJobBatchDelay: 0,
        },
      },
      taskList: {
        nothing: async ({ called_at_us }) => {
          waits.push(Math.max(0, now() - called_at_us));
        },
      },
    });
  console.log("ready");
  for await (const line of createInterface({ input: process.stdin })) {
    if (line === "go") await begin();
    else if (line === "count") console.log(completed);
    else throw new Error(`what is ${line}?`);
  }
  // A pipe delivers a long line in pieces.
  process.stdout.write(`${JSON.stringify({ waits_us: waits })}\n`, () => process.exit(0));
}

if (role === "setup") {
  await runMigrations({ connectionString });
} else if (role === "submit") {
  await withClient(async (client) => {
    // A statement with very many tasks would be slower per task.
    for (let left = Number(rest[1]); left > 0; left -= BATCH) await add(client, Math.min(left, BATCH));
  });
} else if (role === "offer") {
  await withClient(async (client) => {
    const [count, period] = rest.map(Number);
    const began = performance.now();
    for (let i = 0; i < count; i++) {
      await sleep(Math.max(0, began + i * period - performance.now()));
      await add(client, 1);
    }
  });
} else if (role === "work") {
  await work(Number(rest[0]));
} else {
  throw new Error(`what is ${process.argv.slice(2)}?`);
}
