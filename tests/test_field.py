"""Published problems of the field, as docs/benchmarks.md lists them."""

from benchmarks.field import rotating_beam_records, tumbling_records


def test_the_spin_up_of_simo_and_vu_quoc_is_right_with_one_frame_and_the_deformed_body_s_mass():
    """It turns at 1.6 times the beam's first frequency in the end, where models without stiffening diverge."""
    records = {record.quantity: record for record in rotating_beam_records()}
    assert len(records) == 10
    for words, record in records.items():
        if "configuration" in words:
            assert record.error < (0.05 if "stretch" in words else 0.012), words
    assert records["constant mass: lag at 10 s, m"].error > 0.25
    assert records["constant mass: steady stretch, m"].error > 0.9


def test_momenta_and_energy_are_kept_over_fifty_turns():
    for record in tumbling_records():
        assert record.error < 1e-9, record.quantity
