"""Scores by the requests of commands, as tests ask for them: in one call, with few draws."""

import dataclasses
from pathlib import Path

from flgpr.commands import scoring
from flgpr.commands.entrants import find_entrants
from flgpr.commands.score_request import ScoreRequest, Trial


def request(lists, truth, output, *, recipes=(), register=None, **fields):
    """Return a request; a register may come with its witness."""
    witness = getattr(register, "witness", None)
    trial = Trial(recipes, getattr(register, "path", register), witness)
    lists = [Path(path) for path in lists]
    return ScoreRequest(lists=lists, truth=Path(truth), output=Path(output), trial=trial, **fields)


def find_entrant(path, recipe=None):
    [entrant] = find_entrants([path], [] if recipe is None else [recipe])
    return entrant


def score_alarms(alarms, truth, lane, output, *, recipe=None, **options):
    options |= {"recipes": [] if recipe is None else [recipe], "lane": lane}
    return scoring.score_list(with_rules([alarms], truth, output, **options)).scores


def score_result(folder, truth, output=None, *, recipe=None, register=None):
    output = output or scoring.score_output([Path(folder)])
    recipes = [] if recipe is None else [recipe]
    return tuple(
        scoring.score_result(request([folder], truth, output, recipes=recipes, register=register))
    )


def compare_alarms(lists, truth, output, lane=None, **options):
    return scoring.compare_lists(with_rules(lists, truth, output, lane=lane, **options))


def with_rules(lists, truth, output, **options):
    """Return a request; what is no field of it is a rule."""
    fields = {field.name for field in dataclasses.fields(ScoreRequest)} | {"recipes", "register"}
    rules = {name: options.pop(name) for name in options.keys() - fields}
    return request(lists, truth, output, rules=rules, **options)
