from graspcast.ros.problems import Problems


def test_problems_are_counted_by_kind_with_their_first_case():
    problems = Problems()
    assert not problems
    for case in ("a", "b"):
        problems.add("odd", case)
    problems.add("even")
    assert problems.lines() == ["odd: 2 (first: a)", "even: 1"]


def test_problems_of_parts_are_added_up():
    one, two = Problems(), Problems()
    one.add("odd", "a")
    two.add("odd", "b")
    two.add("even", "c")
    one.update(two)
    assert one.counts() == {"odd": 2, "even": 1}
    assert one.lines() == ["odd: 2 (first: a)", "even: 1 (first: c)"]
