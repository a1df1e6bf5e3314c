//! Trainings and evaluations that do not fit their data are refused with both numbers.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use serde_json::{Value, json};
use spec::{
    ControlBaseline, ControlPath, ControlSpec, DataSpec, EvaluateSpec, JobSpec, SpecError,
    TrainSpec, Training,
};

fn data(samples: u32) -> DataSpec {
    let job = json!({"preset": "D1-chirp", "trajectories": 1000, "samples": samples});
    DataSpec::of(&spec::parse(job.to_string().as_bytes()).unwrap()).unwrap()
}

fn train(preset: &str) -> TrainSpec {
    match training(&json!({"preset": preset})).unwrap() {
        JobSpec::Train(train) => train,
        other => panic!("{other:?}"),
    }
}

fn training(model: &Value) -> Result<JobSpec, SpecError> {
    let job = json!({
        "kind": "train",
        "data": {"dataset": 1},
        "model": model,
        "context": 320,
        "steps": 10,
    });
    spec::parse(job.to_string().as_bytes())
}

#[test]
fn a_u_net_needs_samples_that_it_can_halve() {
    for preset in ["diffuser-tiny", "cdcnn-tiny", "flow-tiny"] {
        train(preset).check_data(&[&data(408)]).unwrap();
        let error = train(preset).check_data(&[&data(404)]).unwrap_err().to_string();
        assert!(error.contains("stride 8") && error.contains("which are 404"), "{error}");
    }
    train("cdt-tiny").check_data(&[&data(405)]).unwrap();
}

#[test]
fn a_patch_has_to_divide_the_horizon() {
    let error = train("robomorph-tiny").check_data(&[&data(401)]).unwrap_err().to_string();
    assert!(error.contains("model.patch is 10") && error.contains("which is 81"), "{error}");
}

fn evaluate(extra: &Value) -> EvaluateSpec {
    let mut job = json!({"kind": "evaluate", "data": {"dataset": 1}});
    for (key, value) in extra.as_object().unwrap() {
        job[key] = value.clone();
    }
    match spec::parse(job.to_string().as_bytes()).unwrap() {
        JobSpec::Evaluate(evaluate) => evaluate,
        other => panic!("{other:?}"),
    }
}

/// The error for an evaluation of `samples` samples with checkpoints trained on 400.
fn refusal(extra: &Value, samples: u32, models: &[&str]) -> String {
    let trainings: Vec<TrainSpec> = models.iter().map(|model| train(model)).collect();
    refusal_of(extra, samples, &trainings)
}

fn refusal_of(extra: &Value, samples: u32, trainings: &[TrainSpec]) -> String {
    let trained_on = data(400);
    let inputs: Vec<Training<'_>> =
        trainings.iter().map(|spec| Training { spec, data: &trained_on }).collect();
    match evaluate(extra).check_inputs(&data(samples), &inputs, &[]) {
        Ok(()) => String::new(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn an_evaluation_needs_samples_for_its_rounds_context_and_horizon() {
    let shifted = json!({"samplers": [{"steps": [1, 5], "start": "shifted"}]});
    assert_eq!(refusal(&shifted, 408, &["cdt-tiny"]), "");
    let error = refusal(&shifted, 400, &["cdt-tiny"]);
    assert!(error.contains("horizon") || error.contains("samples"), "{error}");
    let long = json!({"horizon": 80, "rounds": 9});
    let error = refusal(&long, 408, &[]);
    assert!(error.contains("rounds is 9") && error.contains("need 409"), "{error}");
    let error = refusal(&json!({}), 320, &[]);
    assert!(error.contains("context is 320") && error.contains("which are 320"), "{error}");
}

#[test]
fn checkpoints_of_another_length_are_refused_with_both_numbers() {
    let error = refusal(&json!({"context": 300}), 400, &["cdt-tiny"]);
    assert!(error.contains("trained with context 320") && error.contains("context 300"), "{error}");
    let error = refusal(&json!({}), 380, &["cdt-tiny"]);
    assert!(error.contains("trained with samples 400") && error.contains("samples 380"), "{error}");
    // Equations do not depend on the length.
    assert_eq!(refusal(&json!({"context": 20}), 340, &["lagrangian-tiny"]), "");
    let error = refusal(&json!({"context": 20}), 340, &["lagrangian-tiny", "cdt-tiny"]);
    assert!(error.contains("checkpoints[1]") && !error.contains("checkpoints[0]"), "{error}");
    assert_eq!(refusal(&json!({"horizon": 80}), 500, &["cdt-tiny"]), "");
}

#[test]
fn equations_answer_at_multiples_of_their_rate_and_networks_do_not() {
    let at = |rate_hz: f64, model: &str| {
        let mut asked = json!({"preset": "D1-chirp", "trajectories": 10, "samples": 800});
        asked["rate_hz"] = json!(rate_hz);
        let asked = DataSpec::of(&spec::parse(asked.to_string().as_bytes()).unwrap()).unwrap();
        let (trained, on) = (train(model), data(400));
        let inputs = [Training { spec: &trained, data: &on }];
        let context = if model == "cdt-tiny" { 320 } else { 640 };
        let spec = evaluate(&json!({"context": context, "horizon": 80}));
        spec.check_inputs(&asked, &inputs, &[]).map_err(|error| error.to_string())
    };
    for rate_hz in [60.0, 120.0, 960.0] {
        assert_eq!(at(rate_hz, "lagrangian-tiny"), Ok(()));
    }
    assert_eq!(at(60.0, "cdt-tiny"), Ok(()));
    for (rate_hz, model) in
        [(30.0, "lagrangian-tiny"), (90.0, "lagrangian-tiny"), (120.0, "cdt-tiny")]
    {
        let error = at(rate_hz, model).unwrap_err();
        let both = ["trained with rate_hz 60".to_owned(), format!("rate_hz {rate_hz}")];
        assert!(both.iter().all(|text| error.contains(text)), "{error}");
    }
}

#[test]
fn a_law_is_told_an_arm_with_the_joints_of_the_data() {
    let told = |robot: Value| {
        let spec = training(&json!({"architecture": "lagrangian", "robot": robot}))?;
        let JobSpec::Train(train) = spec else { panic!("a training") };
        train.check_data(&[&data(400)])
    };
    assert_eq!(told(json!({"model": "panda", "gravity": "off"})), Ok(()));
    let error = told(json!({"model": "ur10e"})).unwrap_err().to_string();
    let both = ["model.robot.model is an arm of 6 joints", "an arm of 7 joints, as the data has"];
    assert!(both.iter().all(|text| error.contains(text)), "{error}");
    for (robot, field) in [
        (json!({"model": "pandas"}), "model.robot.model"),
        (json!({"gravity": "on"}), "model"),
        (json!({"model": "panda", "gravity": "heavy"}), "model.robot.gravity"),
    ] {
        let error = told(robot).unwrap_err().to_string();
        assert!(error.contains(field), "{field}: {error}");
    }
}

#[test]
fn a_training_with_a_least_context_answers_each_multiple_of_its_patch() {
    let model = json!({"preset": "prefix-transformer-tiny", "least_context": 20});
    let Ok(JobSpec::Train(trained)) = training(&model) else { panic!("a training") };
    let trained = [trained];
    for (context, samples) in [(320, 400), (20, 100), (20, 400), (35, 40)] {
        assert_eq!(refusal_of(&json!({"context": context}), samples, &trained), "");
    }
    let cases = [(15, 95, "context 20"), (33, 100, "context 30"), (30, 57, "samples 55")];
    for (context, samples, nearest) in cases {
        let error = refusal_of(&json!({"context": context}), samples, &trained);
        assert!(error.contains(&format!("answers as the nearest {nearest}")), "{error}");
    }
    for (least, allowed) in [(22, "a multiple of patch"), (325, "at most context, which is 320")] {
        let model = json!({"preset": "prefix-transformer-tiny", "least_context": least});
        let error = training(&model).unwrap_err().to_string();
        assert!(error.contains("model.least_context") && error.contains(allowed), "{error}");
    }
}

#[test]
fn a_share_of_trajectories_that_rounds_to_none_is_doubted_with_the_least_that_keeps_one() {
    let mut train = train("robomorph-tiny");
    let doubt = |train: &TrainSpec, counts: &[Option<u64>]| {
        train.validation_doubt(counts).map(|doubt| doubt.to_string()).unwrap_or_default()
    };
    assert_eq!(
        doubt(&train, &[Some(3)]),
        "validation_fraction is 0.1: this keeps 0 of 3 trajectories, so nothing validates the training and no checkpoint \
         is the best; 0.1667 keeps one"
    );
    let of_two = doubt(&train, &[Some(3), Some(4)]);
    assert!(
        of_two.contains("0 of 7 trajectories") && of_two.ends_with("; 0.125 keeps one"),
        "{of_two}"
    );
    assert!(doubt(&train, &[Some(1)]).ends_with("a validation needs two trajectories or more"));
    for counts in [&[Some(5)][..], &[Some(3), Some(100)], &[Some(3), None], &[None]] {
        assert_eq!(doubt(&train, counts), "", "{counts:?}");
    }
    for all in (2..300).chain([1000, 123_457, 4_000_000]) {
        train.validation_fraction = 1e-9;
        let said = doubt(&train, &[Some(all)]);
        let least = said.rsplit_once("; ").unwrap().1.split(' ').next().unwrap();
        train.validation_fraction = least.parse().unwrap();
        assert_eq!(train.validation_part(all), 1, "{all}: {least}");
    }
    train.validation_fraction = 0.0;
    assert_eq!(doubt(&train, &[Some(3)]), "", "a training without a validation is meant");
}

#[test]
fn samplers_need_a_denoiser_with_as_many_steps() {
    let steps = json!({"samplers": [{"kind": "ddim", "steps": [5, 101]}]});
    let error = refusal(&steps, 400, &["cdt-tiny", "robomorph-tiny"]);
    let expected =
        "samplers.steps is 101, for checkpoints[0], allowed: at most diffusion.steps, which is 100";
    assert!(error.contains(expected), "{error}");
    let error = refusal(&steps, 400, &["robomorph-tiny"]);
    assert!(error.contains("samplers[0] is ddim"), "{error}");
    let error = refusal(&steps, 400, &["flow-tiny"]);
    assert!(error.contains("samplers[0] is ddim"), "{error}");
    let both =
        json!({"samplers": [{"kind": "ddim", "steps": 5}, {"kind": "euler", "steps": [1, 2]}]});
    assert_eq!(refusal(&both, 400, &["cdt-tiny", "flow-tiny"]), "");
    let eta = json!({"samplers": [{"kind": "ddpm", "eta": 0.5}]});
    let error = refusal(&eta, 400, &["cdt-tiny"]);
    assert!(error.contains("0.5, for checkpoints[0]") && error.contains("ddim"), "{error}");
    let twice = json!({"samplers": [{"steps": 5}, {"steps": [1, 5]}]});
    let error = refusal(&twice, 400, &["cdt-tiny"]);
    assert!(error.contains("5 cold twice"), "{error}");
}

fn arms_of_six() -> DataSpec {
    let model: Value =
        serde_json::from_str(include_str!("../../../tests/data/arm_of_six.json")).unwrap();
    let job = json!({"preset": "D1-chirp", "trajectories": 1000, "robot": {"model": model}});
    DataSpec::of(&spec::parse(job.to_string().as_bytes()).unwrap()).unwrap()
}

#[test]
fn loss_weights_are_one_for_each_joint_of_the_data() {
    let weighted =
        |count: usize| TrainSpec { loss_weights: Some(vec![1.0; count]), ..train("cdt-tiny") };
    weighted(7).check_data(&[&data(400)]).unwrap();
    let error = weighted(2).check_data(&[&data(400)]).unwrap_err().to_string();
    assert!(error.contains("loss_weights is 2 numbers") && error.contains("7 numbers"), "{error}");
}

fn control(extra: &Value) -> ControlSpec {
    let mut job = json!({"kind": "control", "data": {"dataset": 1}});
    for (key, value) in extra.as_object().unwrap() {
        job[key] = value.clone();
    }
    match spec::parse(job.to_string().as_bytes()).unwrap() {
        JobSpec::Control(control) => control,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_path_that_could_leave_a_joint_s_limits_is_refused() {
    let refusal = |path: &Value| {
        let control = control(&json!({"path": path}));
        control.check_inputs(&data(400), &[]).unwrap_err().to_string()
    };
    let swing = json!({"swing": {"amplitude_rad": [0.4, 0.4, 0.4, 1.5, 0.4, 0.4, 0.4]}});
    let error = refusal(&swing);
    for part in ["path.swing.amplitude_rad[3] is 1.5", "0 to 1.4010", "limits"] {
        assert!(error.contains(part), "{error}");
    }
    let point = json!({"displacement_rad": [0.1, 2.0, 0, 0, 0, 0, 0], "duration_s": 1});
    let error = refusal(&json!({"point-to-point": point}));
    assert!(error.contains("displacement_rad[1] is 2") && error.contains("0 to 1.6628"), "{error}");
}

#[test]
fn paths_and_noise_have_one_number_for_each_joint_and_noise_no_more_than_a_joint_can() {
    let lists = json!({
        "path": {"swing": {"amplitude_rad": vec![0.1; 7], "frequency_hz": vec![0.1; 5]}},
        "planner": {"noise_nm": [1]},
    });
    let error = control(&lists).check_inputs(&arms_of_six(), &[]).unwrap_err().to_string();
    for part in [
        "path.swing.amplitude_rad is 7 numbers",
        "path.swing.frequency_hz is 5 numbers",
        "planner.noise_nm is 1 numbers",
        "6 numbers, one for each joint",
    ] {
        assert!(error.contains(part), "{error}");
    }
    let loud = control(&json!({"planner": {"noise_nm": [2, 2, 2, 2, 2, 2, 88]}}));
    let error = loud.check_inputs(&data(400), &[]).unwrap_err().to_string();
    assert!(error.contains("planner.noise_nm[6] is 88") && error.contains("at most 87"), "{error}");
}

#[test]
fn paths_and_noise_that_are_left_out_fit_the_robot_of_the_data() {
    let fitted = |extra: &Value, data: &DataSpec| {
        let mut job = JobSpec::Control(control(extra));
        job.fit_to_data(data);
        match job {
            JobSpec::Control(control) => control,
            other => panic!("{other:?}"),
        }
    };
    let of_panda = fitted(&json!({}), &data(400));
    assert_eq!(of_panda, control(&json!({})));
    assert_eq!(of_panda.planner.noise_nm, [2.0; 7]);

    let of_six = fitted(&json!({"context": 30}), &arms_of_six());
    of_six.check_inputs(&arms_of_six(), &[]).unwrap();
    let ControlPath::Swing(swing) = &of_six.path else { panic!("{of_six:?}") };
    assert_eq!(swing.amplitude_rad, [0.4; 6]);
    assert_eq!(swing.frequency_hz, [0.15, 0.2, 0.25, 0.15, 0.2, 0.25]);
    assert_eq!(of_six.planner.noise_nm.len(), 6);

    let given = json!({"context": 30, "planner": {"noise_nm": vec![0.5; 6]}});
    assert_eq!(fitted(&given, &arms_of_six()).planner.noise_nm, [0.5; 6]);
}

fn arms_under_a_controller() -> DataSpec {
    let job = json!({"preset": "panda-real", "trajectories": 10, "samples": 400});
    DataSpec::of(&spec::parse(job.to_string().as_bytes()).unwrap()).unwrap()
}

#[test]
fn arms_with_a_controller_follow_their_references_by_models_that_say_torques() {
    let arms = arms_under_a_controller();
    let mut job = JobSpec::Control(control(&json!({"duration_s": 1})));
    job.fit_to_data(&arms);
    let JobSpec::Control(fitted) = job else { panic!("a control job") };
    assert_eq!(fitted.baselines, ControlBaseline::all());
    let law = train("lagrangian-tiny");
    fitted.check_inputs(&arms, &[Training { spec: &law, data: &arms }]).unwrap();

    let refused = |fields: Value, model: &str| {
        let training = train(model);
        let training = Training { spec: &training, data: &arms };
        control(&fields).check_inputs(&arms, &[training]).unwrap_err().to_string()
    };
    let own_path = json!({
        "path": {"swing": {"amplitude_rad": vec![0.1; 7]}}, "planner": {"samples": 3},
        "robots": 1, "duration_s": 1.4,
    });
    let error = refused(own_path, "robomorph-tiny");
    for part in [
        "path is given",
        "references of their controllers",
        "planner is given",
        "duration_s is 1.4",
        "at most 1.3333333333333333 s",
        "checkpoints[0] is robomorph",
        "lagrangian",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let plans = json!({"baselines": ["identification"]});
    let error = control(&plans).check_inputs(&data(400), &[]).unwrap_err().to_string();
    assert!(error.contains("baselines[0]") && error.contains("does not plan"), "{error}");
}

/// A fine-tuning on several sources, with `changes`.
fn fine_tuning(changes: &Value) -> TrainSpec {
    let mut job = json!({
        "kind": "train", "data": {"dataset": 1}, "model": {"preset": "robomorph-tiny"},
        "init": {"checkpoint": 3}, "steps": 10,
    });
    for (key, value) in changes.as_object().unwrap() {
        job[key] = value.clone();
    }
    job.as_object_mut().unwrap().retain(|_, value| !value.is_null());
    match spec::parse(job.to_string().as_bytes()).unwrap() {
        JobSpec::Train(train) => train,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_fine_tuning_fits_the_training_that_it_begins_from() {
    let (ours, theirs) = (data(400), data(400));
    let refused = |changes: Value, earlier: &TrainSpec, theirs: &DataSpec| {
        let init = Training { spec: earlier, data: theirs };
        fine_tuning(&changes).check_init(&ours, &init).err().map(|error| error.to_string())
    };
    let earlier = train("robomorph-tiny");
    assert_eq!(refused(json!({}), &earlier, &theirs), None);
    let free = json!({"model": {"preset": "robomorph-tiny", "loss": "root-mean-square"}});
    assert_eq!(refused(free, &earlier, &theirs), None);

    let error = refused(json!({"model": {"preset": "cdt-tiny"}}), &earlier, &theirs).unwrap();
    let expected = "model.architecture is cdt, allowed: robomorph, as init was trained";
    assert_eq!(error, expected);
    let deeper = json!({"model": {"preset": "robomorph-tiny", "encoder_layers": 9}});
    let error = refused(deeper, &earlier, &theirs).unwrap();
    assert!(error.contains("model.encoder_layers is 9, allowed: "), "{error}");
    let error = refused(json!({"context": 200}), &earlier, &theirs).unwrap();
    assert!(error.contains("context is 200, allowed: 320, as init was trained"), "{error}");
    let error = refused(json!({}), &earlier, &data(410)).unwrap();
    assert!(error.contains("data.samples is 400, allowed: 410, as init was trained"), "{error}");
    let error = refused(json!({"normalization": "dataset"}), &earlier, &theirs).unwrap();
    assert!(error.contains("normalization is dataset, allowed: context, as"), "{error}");

    let arm = json!({"preset": "ur10e-real", "trajectories": 3, "samples": 400, "rate_hz": 50});
    let arm = DataSpec::of(&spec::parse(arm.to_string().as_bytes()).unwrap()).unwrap();
    let error = refused(json!({}), &earlier, &arm).unwrap();
    assert!(error.contains("data.joints is 7, allowed: 6, as init was trained"), "{error}");
    assert!(error.contains("data.rate_hz is 60, allowed: 50, as init was trained"), "{error}");
}

#[test]
fn every_batch_has_the_weighted_share_of_each_source() {
    let shares = |batch: u32, weights: Value| {
        let sources = json!([{"dataset": 1}, {"dataset": 2}, {"dataset": 3}]);
        fine_tuning(&json!({"data": sources, "data_weights": weights, "batch_size": batch}))
            .shares()
    };
    assert_eq!(fine_tuning(&json!({})).shares(), [64]);
    assert_eq!(shares(64, Value::Null), [22, 21, 21]);
    assert_eq!(shares(64, json!([2, 1, 1])), [32, 16, 16]);
    assert_eq!(shares(7, json!([1, 1, 5])), [1, 1, 5]);
    assert_eq!(shares(10, json!([0.5, 0.26, 0.24])), [5, 3, 2]);
    for batch in 3..200 {
        let shares = shares(batch, json!([1, 1.37, 0.81]));
        assert_eq!(shares.iter().sum::<u32>(), batch);
    }
}

#[test]
fn sources_of_a_mixture_are_alike_and_large_enough() {
    let mixture = |batch: u32| {
        let sources = json!([{"dataset": 1}, {"dataset": 2}]);
        fine_tuning(&json!({"data": sources, "batch_size": batch, "data_weights": [1, 3]}))
    };
    mixture(64).check_data(&[&data(400), &data(400)]).unwrap();
    let error = mixture(64).check_data(&[&data(400), &data(410)]).unwrap_err().to_string();
    assert!(error.contains("data[1] is with samples 410, allowed: 400, as data[0]"), "{error}");
    let few = json!({"preset": "D1-chirp", "trajectories": 50, "samples": 400});
    let few = DataSpec::of(&spec::parse(few.to_string().as_bytes()).unwrap()).unwrap();
    mixture(60).check_data(&[&data(400), &few]).unwrap();
    let error = mixture(64).check_data(&[&data(400), &few]).unwrap_err().to_string();
    let expected = "batch_size is 64, of which 48 are of data[1], allowed: at most the number of \
                    training trajectories of data[1], which is 45";
    assert!(error.contains(expected), "{error}");
    mixture(64).check_trajectories(&[None, Some(1000)]).unwrap();
    assert!(mixture(64).check_trajectories(&[Some(10), Some(1000)]).is_err());
}

#[test]
fn references_are_given_of_simulations_with_a_controller_alone() {
    let given = json!({
        "init": null, "given": "references",
        "model": {"preset": "robomorph-tiny", "residual": "reference"},
    });
    let spec = fine_tuning(&given);
    let controlled = json!({"preset": "panda-real", "trajectories": 1000, "samples": 400});
    let controlled =
        DataSpec::of(&spec::parse(controlled.to_string().as_bytes()).unwrap()).unwrap();
    spec.check_data(&[&controlled]).unwrap();
    let error = spec.check_data(&[&data(400)]).unwrap_err().to_string();
    assert!(error.contains("data is without references"), "{error}");

    let asked = evaluate(&json!({"given": "references"}));
    let names: Vec<Value> =
        asked.baselines.iter().map(|baseline| serde_json::to_value(baseline).unwrap()).collect();
    let untold = ["hold-last", "constant-velocity", "follow-reference", "least-squares", "arx"];
    let expected: Vec<&str> = untold.into_iter().chain(["nominal-simulator"]).collect();
    assert_eq!(names, expected);
    let training = Training { spec: &spec, data: &controlled };
    asked.check_inputs(&controlled, &[training], &[]).unwrap();
    let error = asked.check_inputs(&data(400), &[training], &[]).unwrap_err().to_string();
    assert!(error.contains("data is without references"), "{error}");
    let of_torques = evaluate(&json!({}));
    let error = of_torques.check_inputs(&controlled, &[training], &[]).unwrap_err().to_string();
    assert!(error.contains("trained with given references"), "{error}");
}
