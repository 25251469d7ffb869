"""In a whole flight, an effect at null is not there, to the last bit.

That each shows at its typical size, and vanishes with it, test_effects_registry says.
"""

import pytest
from kernel_flight import NOISY, fly_kernel

from tombo_dynamics.effects import REGISTRY


@pytest.mark.parametrize("name", REGISTRY)
def test_at_null_the_log_is_the_same_to_the_last_bit(name):
    others = {key: values for key, values in NOISY.items() if key != name}
    nulls = {name: {p.name: p.null for p in REGISTRY[name].theta}}
    without, null = (fly_kernel(e, seconds=0.3, seed=11) for e in (others, others | nulls))
    assert without.begins_like(null)
    assert (without.mocap == null.mocap).all()
