import numpy as np

from baselines.splatting.schedule import Stream, random_stream


def test_every_purpose_has_a_stream_of_its_own_which_stays_what_it_is():
    numbers = {stream: random_stream(3, stream, 10).random() for stream in Stream}
    assert len(set(numbers.values())) == len(Stream) == 9
    assert numbers[Stream.ABSENCE] == np.random.default_rng((3, 6, 10)).random()
    assert numbers[Stream.ABSENCE] != random_stream(3, Stream.ABSENCE, 11).random()
