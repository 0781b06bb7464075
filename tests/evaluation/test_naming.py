from __future__ import annotations

from trailmark.evaluation import find_metric, metric_name, quantity_of
from trailmark.evaluation.naming import number_text


def test_a_name_carries_its_protocol() -> None:
    assert metric_name("ate_rmse_m", "se2", "n=1200") == "ate_rmse_m[se2,n=1200]"
    assert metric_name("end_error_m") == "end_error_m"


def test_the_quantity_is_the_name_without_its_protocol() -> None:
    assert quantity_of("ate_rmse_m[se2,n=1200]") == "ate_rmse_m"
    assert quantity_of("plain") == "plain"


def test_a_metric_is_found_by_its_quantity_and_words_of_its_protocol() -> None:
    metrics = {"ate_rmse_m[se2,n=3]": 0.1, "ate_rmse_m[origin,n=3]": 0.2, "ate_rmse_mm[se2]": 5.0}

    assert find_metric(metrics, "ate_rmse_m") == 0.1
    assert find_metric(metrics, "ate_rmse_m", "origin") == 0.2
    assert find_metric(metrics, "ate_rmse_m", "none") is None


def test_numbers_in_names_have_three_digits_and_no_exponent() -> None:
    assert [number_text(value) for value in (1.0, 0.5, 0.0214285, 200.0, 123456.0)] == [
        "1",
        "0.5",
        "0.0214",
        "200",
        "123000",
    ]
