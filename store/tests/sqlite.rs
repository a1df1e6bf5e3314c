//! Runs the suite against SQLite, with objects in the data folder and elsewhere.

#![expect(clippy::unwrap_used, reason = "tests")]

mod suite;

use std::sync::Arc;

use store::{Access, Store};
use suite::Fixture;

async fn fixture() -> Fixture {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::open(dir.path(), Access::Server).await.unwrap();
    Fixture { store, _dir: dir }
}

/// A store whose objects are no files.
async fn with_objects_elsewhere() -> Fixture {
    let dir = tempfile::tempdir().unwrap();
    let objects = Arc::new(object_store::memory::InMemory::new());
    let store = Store::open_with_objects(dir.path(), Access::Server, objects).await.unwrap();
    Fixture { store, _dir: dir }
}

macro_rules! conforms {
    ($fixture:ident => $($room:ident: $($law:ident),+ $(,)?;)+) => {
        $(mod $room {
            $(
                #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
                async fn $law() {
                    crate::suite::$room::$law(crate::$fixture().await).await;
                }
            )+
        })+
    };
}

conforms! {
    fixture =>
    leases:
        a_claimed_task_carries_all_that_its_worker_needs,
        a_killed_worker_loses_its_lease_and_its_late_writes,
        a_lease_that_is_renewed_is_not_reaped,
        a_task_that_kills_its_worker_fails_after_max_attempts,
        the_first_retry_comes_at_once_and_the_second_later,
        a_failure_that_would_repeat_is_not_retried,
        a_released_task_is_claimed_again_without_losing_an_attempt,
        tasks_are_claimed_by_priority_and_then_in_order,
        two_claimers_never_get_the_same_task,
        a_finished_task_takes_no_second_ending,
        leases_outlive_a_sleep_of_everybody,
        a_worker_that_never_renews_is_noticed,
        attempts_before_a_later_checkpoint_do_not_count,
        every_attempt_is_recorded_with_its_end,
        an_attempt_that_was_cancelled_or_lost_says_so,
        a_paused_queue_hands_out_nothing_and_takes_everything;
    workers:
        a_worker_is_listed_with_its_task_until_it_leaves,
        a_worker_that_began_anew_is_not_forgotten_by_the_one_before,
        the_task_of_a_worker_that_died_goes_to_the_next_at_once,
        a_worker_that_was_told_to_stop_loses_no_attempt;
    takeover:
        shards_of_a_job_that_failed_are_there_for_the_next,
        a_training_goes_on_where_one_that_failed_ended,
        a_job_that_is_to_be_done_anew_takes_nothing_over;
    propagation:
        a_stage_waits_for_all_tasks_of_the_stage_before,
        a_pipeline_runs_its_jobs_in_the_order_of_their_needs,
        a_failed_job_cancels_those_that_need_it_and_fails_its_pipeline,
        a_pipeline_ends_when_its_last_member_does,
        a_job_waits_for_one_that_was_submitted_before;
    submission:
        a_job_that_was_done_is_not_done_again,
        execution_does_not_tell_jobs_apart,
        a_job_that_says_what_is_the_case_is_done_every_time,
        a_job_that_failed_is_done_again,
        an_evaluation_takes_over_the_cells_of_one_that_failed,
        an_evaluation_that_lacks_its_report_alone_begins_with_it,
        a_job_that_is_being_cancelled_is_not_reused,
        force_computes_anew_and_needs_point_to_the_new_jobs,
        a_pipeline_is_reused_whole_or_job_by_job,
        a_pipeline_that_can_only_fail_is_not_reused,
        a_submission_that_is_dropped_halfway_leaves_nothing,
        a_repeated_request_does_what_the_first_did,
        an_inconsistent_submission_leaves_nothing,
        jobs_are_listed_newest_first_in_pages,
        experiments_are_what_somebody_asked_for,
        jobs_are_filtered_by_kind_and_state,
        a_job_is_found_by_its_digest,
        what_does_not_exist_is_named;
    lists:
        tasks_are_read_in_pages_in_the_order_in_which_they_run,
        results_are_counted_by_the_value_of_a_field,
        the_only_task_of_the_last_stage_speaks_for_its_job,
        what_belongs_to_several_jobs_is_read_at_once;
    cancellation:
        tasks_that_nobody_has_are_cancelled_at_once,
        a_running_task_is_told_and_then_ends_its_job,
        a_cancelled_task_is_not_tried_again,
        what_has_ended_cannot_be_cancelled,
        a_cancelled_pipeline_cancels_its_members,
        a_cancelled_pipeline_spares_what_others_need,
        a_member_that_a_job_outside_needs_goes_on;
    metrics:
        a_step_that_is_taken_again_replaces_its_metrics,
        the_latest_value_of_each_key_is_at_hand,
        a_long_series_is_thinned_out_without_losing_its_extremes,
        a_loss_that_is_not_a_number_is_kept_as_such,
        an_unknown_key_has_no_points;
    datasets:
        the_last_shard_completes_dataset_and_job,
        a_shard_committed_twice_is_there_once,
        a_dataset_without_all_its_trajectories_is_not_complete,
        a_zombie_neither_commits_nor_overwrites_a_shard,
        a_row_never_comes_before_its_bytes,
        what_shards_hold_adds_up_over_their_dataset,
        the_dataset_of_a_job_that_failed_is_abandoned;
    checkpoints:
        a_training_resumes_from_its_latest_checkpoint,
        the_final_checkpoint_is_found_by_digest,
        a_step_that_is_taken_again_keeps_its_checkpoints_id,
        old_checkpoints_are_pruned_with_their_bytes,
        a_pruned_checkpoint_leaves_no_empty_folder,
        a_checkpoint_that_nobody_can_use_is_discarded,
        one_checkpoint_of_a_training_is_the_best_and_one_the_last,
        the_best_checkpoint_is_never_pruned;
    artifacts:
        an_artifact_is_replaced_under_its_name,
        every_training_and_evaluation_has_a_run;
    objects:
        an_object_is_downloaded_whole_or_in_part,
        an_object_written_in_pieces_appears_when_finished,
        damaged_bytes_are_refused,
        the_last_bytes_of_a_damaged_object_are_never_sent,
        an_object_of_another_size_is_refused_before_its_first_byte,
        the_first_range_of_an_object_has_all_of_it_checked,
        a_table_is_written_and_read_wherever_it_lies,
        what_was_published_but_not_committed_is_swept;
    uploads:
        a_file_is_found_by_its_digest,
        a_file_that_is_sent_again_is_kept_once,
        a_file_that_was_lost_can_be_sent_again,
        a_file_that_breaks_off_leaves_nothing,
        a_file_is_no_orphan_and_what_was_not_committed_is,
        a_changed_file_is_not_opened,
        an_import_tells_how_many_trajectories_there_are;
}

mod objects_elsewhere {
    conforms! {
        with_objects_elsewhere =>
        datasets:
            the_last_shard_completes_dataset_and_job,
            a_zombie_neither_commits_nor_overwrites_a_shard,
            a_row_never_comes_before_its_bytes;
        checkpoints:
            a_training_resumes_from_its_latest_checkpoint,
            old_checkpoints_are_pruned_with_their_bytes;
        takeover:
            shards_of_a_job_that_failed_are_there_for_the_next,
            a_training_goes_on_where_one_that_failed_ended;
        artifacts:
            an_artifact_is_replaced_under_its_name;
        objects:
            an_object_is_downloaded_whole_or_in_part,
            an_object_written_in_pieces_appears_when_finished,
            damaged_bytes_are_refused,
            the_last_bytes_of_a_damaged_object_are_never_sent,
            an_object_of_another_size_is_refused_before_its_first_byte,
            the_first_range_of_an_object_has_all_of_it_checked,
            a_table_is_written_and_read_wherever_it_lies;
        uploads:
            a_file_is_found_by_its_digest,
            a_file_that_is_sent_again_is_kept_once,
            an_import_tells_how_many_trajectories_there_are;
    }
}
