import { Button } from "@mantine/core";
import { type ReactNode, useState } from "react";
import { dateTime } from "../samples/format";
import type { FormDraft } from "../service/forms/drafts";
import draftMarkStyles from "./DraftMark.module.css";

/** Says that a form holds a draft, since when, and offers to discard it. Discarding asks first. */

interface DraftMarkProps {
  readonly draft: Pick<FormDraft<unknown>, "since" | "stored">;
  /** What the draft is of, for screen readers: "experiment". */
  readonly of: string;
  /** What stands first in the mark. */
  readonly words?: string;
  /** What discarding brings back. */
  readonly back: string;
  onDiscard(): void;
}

export function DraftMark({ draft, of, words = "Draft, not saved", back, onDiscard }: DraftMarkProps) {
  const [asking, ask] = useState(false);
  if (draft.since === null) return null;
  return (
    // biome-ignore lint/a11y/useSemanticElements: a mark of a form is no fieldset
    <div className={draftMarkStyles.mark} role="group" aria-label={`Draft of the ${of}`}>
      <span>
        {words}, since {dateTime(draft.since)}.
        {!draft.stored && " This browser stores nothing: a reload loses it."}
      </span>
      {asking ? (
        <>
          <span>Discard it? {back}</span>
          <Button
            size="compact-xs"
            color="red"
            variant="light"
            onClick={() => {
              ask(false);
              onDiscard();
            }}
          >
            Discard draft
          </Button>
          <Button size="compact-xs" variant="default" onClick={() => ask(false)}>
            Keep draft
          </Button>
        </>
      ) : (
        <Button
          size="compact-xs"
          variant="default"
          aria-label={`Discard the draft of the ${of}`}
          onClick={() => ask(true)}
        >
          Discard …
        </Button>
      )}
    </div>
  );
}

/** Asks before something else takes the place of a draft. */

/**
 * Returns a guard, which runs an action at once where there is no draft and else after a question, and the question.
 *
 * Args:
 *   isDraft: whether there is a draft that the action would replace.
 */
export function useReplaceDraft(isDraft: boolean): [(action: () => void) => void, ReactNode] {
  const [waiting, wait] = useState<{ readonly action: () => void } | null>(null);
  const guard = (action: () => void): void => (isDraft ? wait({ action }) : action());
  const question =
    waiting === null ? null : (
      <div className={draftMarkStyles.mark} role="alertdialog" aria-label="Replace the draft">
        <span>This replaces the draft, which is not saved.</span>
        <Button
          size="compact-xs"
          color="red"
          variant="light"
          onClick={() => {
            wait(null);
            waiting.action();
          }}
        >
          Replace draft
        </Button>
        <Button size="compact-xs" variant="default" onClick={() => wait(null)}>
          Keep draft
        </Button>
      </div>
    );
  return [guard, question];
}
