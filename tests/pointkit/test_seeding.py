import numpy as np

from pointkit.seeding import generator


def test_the_same_names_give_the_same_numbers() -> None:
    assert generator(7, "scan", "room").random() == generator(7, "scan", "room").random()


def test_seed_names_and_their_borders_all_matter() -> None:
    draws = [
        generator(*arguments).random()
        for arguments in [(7, "ab", "c"), (7, "a", "bc"), (8, "ab", "c"), (7, "ab"), (7,)]
    ]
    assert len(set(draws)) == len(draws)


def test_numbers_are_those_of_numpys_seed_sequence() -> None:
    words = np.frombuffer(
        bytes.fromhex("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"), "<u4"
    )  # SHA-256 of nothing
    sequence = np.random.SeedSequence([3, *words.tolist()])
    assert generator(3).random() == np.random.Generator(np.random.PCG64(sequence)).random()
