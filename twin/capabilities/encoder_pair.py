"""What two encoders alone say of a pair, where the machine has no model."""

from __future__ import annotations

from dataclasses import replace

from twin.assessment import EncoderPair
from twin.capabilities.context import Context, Draft


def applies(context: Context, draft: Draft) -> bool:
    """Where the window has two encoders and the rig file no model."""
    return not draft.modelled and context.pair is not None


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the pair's motion; where it is not available, with that of the latest window that showed it."""
    pair = context.pair
    if not isinstance(pair, EncoderPair):
        return draft if draft.state.latest.encoder_pair is not None else draft.with_parts(encoder_pair=pair)
    draft = replace(draft, judged=not draft.state.tracing.stages).with_latest(encoder_pair=pair)
    draft = draft.with_parts(
        encoder_pair=pair,
        window=replace(draft.record, speed=pair.pinion_speed.mean),  # the mean through run-up and stop
    )
    if pair.stated is None or not pair.stated.contradicted:
        return draft
    return draft.noted(
        f"the encoders' ratio {pair.ratio.value:.4f} ± {pair.ratio.std:.4f} contradicts {pair.stated.source}"
    )  # fmt: skip
