"""What went wrong in programs of this kind, each with the test here that would notice.

The tests lie in their own rooms; this file only keeps them from being lost by renaming.
"""

import ast
from pathlib import Path

import pytest

HERE = Path(__file__).parent

TRAPS = {
    "slip compares frames that do not follow each other": (
        "energy/test_terms.py::test_slip_acts_only_between_consecutive_frames_that_are_both_in_contact",
        "energy/test_paper.py::test_slip_compares_neighbours_only",
    ),
    "contact is one-sided or without its range": (
        "energy/test_terms.py::test_contact_pulls_from_both_sides_and_only_from_within_reach",
        "energy/test_terms.py::test_the_papers_range_of_contact",
        "energy/test_paper.py::test_contact_is_an_l1_distance_below_20_cm_from_either_side",
        "scene/test_contacts.py::test_contact_is_two_sided",
    ),
    "the body's depth has a bias": (
        "energy/test_terms.py::test_depth_by_hand_and_without_a_mask_no_term",
        "optimise/test_joint_energy.py::test_true_depth_has_no_bias",
        "optimise/test_raster_evidence.py::test_at_the_truth_bodies_and_depth_map_agree",
        "optimise/test_paper.py::test_depth_meets_the_truth_without_a_bias",
    ),
    "priors count once for each batch of frames": (
        "optimise/test_joint_energy.py::test_the_scale_terms_do_not_depend_on_the_number_of_frames",
        "optimise/test_joint_energy.py::test_depth_counts_as_a_few_measurements_whatever_the_length",
        "optimise/test_paper.py::test_the_batch_size_changes_nothing",
    ),
    "the one-euro filter is given absolute times": (
        "optimise/test_one_euro.py::test_late_frames_are_filtered_like_early_ones",
        "optimise/test_one_euro.py::test_noise_reduction_is_even_along_one_clip",
    ),
    "people who enter late are lost": (
        "tracking/test_link.py::test_late_entrance_and_early_leaving",
        "test_pipeline.py::test_late_entrants_are_in_the_take_from_their_first_sight_on",
        "optimise/test_solve.py::test_frames_without_evidence_are_filled_without_a_jump",
    ),
    "ids are exchanged": (
        "tracking/test_link.py::test_people_who_cross_keep_their_ids",
        "tracking/test_link.py::test_both_vanish_while_they_cross_and_come_back_as_themselves",
    ),
    "people beyond 10 m are never reached": (
        "optimise/test_placement.py::test_exact_from_one_to_fifty_metres",
        "optimise/test_solve.py::test_far_and_near_people_both_get_their_place",
    ),
    "the start takes hundreds of steps of descent": (
        "optimise/test_placement.py::test_exact_from_one_to_fifty_metres",
        "optimise/test_placement.py::test_batches_keep_their_shape_and_order",
    ),
    "softplus overflows": ("optimise/test_paper.py::test_depths_and_scales_are_positive_and_finite_whatever_the_step",),
    "the depth range turns over or overflows": (
        "optimise/test_joint_energy.py::test_near_is_always_nearer_than_far",
        "optimise/test_scale_ground.py::test_a_far_end_beyond_all_measure_stays_a_number",
    ),
    "an all-zero mask": (
        "optimise/test_solve.py::test_poor_evidence_gives_finite_answers",
        "optimise/test_raster_evidence.py::test_without_a_mask_there_is_no_pull",
        "optimise/test_paper.py::test_poor_evidence_gives_finite_results",
    ),
    "nobody in the first frame": ("optimise/test_solve.py::test_poor_evidence_gives_finite_answers",),
    "one person": (
        "optimise/test_solve.py::test_one_person_alone_is_of_average_height",
        "optimise/test_solve.py::test_the_least_there_can_be",
    ),
    "portrait video and uneven focal lengths": (
        "optimise/test_pose_fit.py::test_any_lens_gives_the_same_pose_and_place",
        "optimise/test_solve.py::test_portrait_uneven_focal_lengths_and_distortion",
    ),
    "a jump": (
        "optimise/test_scale_ground.py::test_one_wild_frame_does_not_lift_the_ground",
        "tracking/test_link.py::test_a_jump_upwards_stays_one_person",
    ),
    "a person cut off by the border": ("optimise/test_solve.py::test_half_a_body_below_the_border",),
    "an unknown field of view goes unsaid": (
        "test_pipeline.py::test_an_assumed_field_of_view_is_announced_and_recorded",
    ),
    "a stronger optimiser shrinks the scene": (
        "optimise/test_joint_energy.py::test_motion_terms_do_not_shrink_the_scene",
        "optimise/test_joint_energy.py::test_contact_neither_shrinks_nor_grows_the_scene",
        "optimise/test_joint_energy.py::test_frames_in_chorus_do_not_talk_the_sizes_away",
        "energy/test_terms.py::test_an_average_adult_is_the_likeliest_person",
        "optimise/test_scale_ground.py::test_a_family_is_not_taken_for_giants",
        "optimise/test_solve.py::test_the_smaller_one_is_smaller_and_not_farther",
    ),
    "the lowest energy is not the best answer": (
        "evaluation/test_scores.py::test_a_wrong_place_shows_in_place_alone",
        "optimise/test_solve.py::test_exact_is_as_good_as_fast",
    ),
    "the whole clip lies in memory": (
        "scene/test_aggregate.py::test_memory_does_not_grow_with_the_clip",
        "scene/test_median.py::test_memory_does_not_grow_with_the_stream",
        "optimise/test_raster_evidence.py::test_many_frames_are_read_in_pieces_that_fit_together",
    ),
    "frames are taken by position instead of by number": (
        "test_pipeline.py::test_a_range_and_every_other_frame",
        "scene/test_aggregate.py::test_pictures_go_with_the_labels_of_their_own_frame",
    ),
}


@pytest.mark.parametrize("trap", TRAPS)
def test_each_trap_is_watched(trap):
    for reference in TRAPS[trap]:
        path, _, name = reference.partition("::")
        functions = {
            node.name for node in ast.walk(ast.parse((HERE / path).read_text())) if isinstance(node, ast.FunctionDef)
        }
        assert name in functions, reference
