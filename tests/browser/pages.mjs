// Every kind of page that the product of `product.mjs` has, by name.

/** Paths of pages by the name of their kind; `ids` are of jobs, datasets and the like that the product made. */
export async function paths(product) {
  const job = async (name) => {
    const member = product.pipeline.members.find((it) => it.name === name);
    return product.get(`/v1/jobs/${member.job}`);
  };
  const [data, training, evaluation] = await Promise.all(["train-set", "train", "evaluate"].map(job));
  return {
    experiments: "/",
    "no experiments": "/?text=no-such-name",
    pipeline: `/jobs/${product.pipeline.id}`,
    job: `/jobs/${training.id}`,
    dataset: `/datasets/${data.dataset}`,
    datasets: "/datasets",
    run: `/runs/${training.run}`,
    runs: "/runs",
    predictions: `/predict?dataset=${data.dataset}&checkpoint=${Math.max(...training.checkpoints)}`,
    checkpoint: `/checkpoints/${Math.max(...training.checkpoints)}`,
    checkpoints: "/checkpoints",
    evaluation: `/evaluations/${evaluation.id}`,
    evaluations: "/evaluations",
    "no evaluations": "/evaluations?text=no-such-name",
    robot: `/robots/${product.robot.id}`,
    robots: "/robots",
    "no robots": "/robots?text=no-such-name",
    comparison: `/compare?run=${training.run},${evaluation.run}`,
    "no comparison": "/compare",
    "all runs": "/logged",
    launch: `/launch?job=${training.id}`,
    upload: "/upload",
    workers: "/workers",
    trash: "/trash",
    deletion: `/datasets/${data.dataset}/delete`,
    API: "/docs",
    login: "/login",
    problem: "/jobs/999999",
  };
}
