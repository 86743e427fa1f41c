"""Scores against sealed truths by the requests of commands, as tests ask for them."""

import dataclasses
from pathlib import Path

import scored
from flgpr_trials.commands import scores
from flgpr_trials.commands.seal import seal


def seal_truth_file(truth, lane, output, passphrase, **rules):
    return seal(truth, lane, output, passphrase=passphrase, **rules)


def sealed_request(lists, sealed, passphrase, output=None, *, witness=None, **options):
    asked = scored.request(lists, sealed, output or f"{sealed}-score", **options)
    trial = dataclasses.replace(asked.trial, passphrase=passphrase)
    if witness is not None:
        trial = dataclasses.replace(trial, witness=witness)
    return dataclasses.replace(asked, trial=trial)


def score_sealed(alarms, sealed, passphrase, output=None, *, recipe=None, **options):
    recipes = [] if recipe is None else [recipe]
    asked = sealed_request([alarms], sealed, passphrase, output, recipes=recipes, **options)
    return scores.score_sealed(asked)


def holds_sealed_score(alarms, sealed, output):
    """Return whether a folder has this very score; nobody is asked for a passphrase."""
    asked = sealed_request([alarms], sealed, None, Path(output))
    [entrant] = scores.find_entrants(asked.lists)
    return scores.holds_sealed_score(asked, entrant)
