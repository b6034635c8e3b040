import { Button } from "@mantine/core";
import { type ReactNode, useState } from "react";
import { dateTime } from "../samples/format";
import { fillText } from "../samples/texts";
import type { FormDraft } from "../service/forms/drafts";
import draftMarkStyles from "./DraftMark.module.css";
import { TEXTS } from "./texts";

/** Shows that a form contains a draft, its time, and a button that discards it after a question. */

interface DraftMarkProps {
  readonly draft: Pick<FormDraft<unknown>, "since" | "stored">;
  /** Name of the form for screen readers: "experiment". */
  readonly of: string;
  /** First words of the mark. */
  readonly words?: string;
  /** Values that the form shows after the draft is discarded. */
  readonly back: string;
  onDiscard(): void;
}

export function DraftMark({ draft, of, words = TEXTS.draft, back, onDiscard }: DraftMarkProps) {
  const [isAsking, setAsking] = useState(false);
  if (draft.since === null) return null;
  return (
    // biome-ignore lint/a11y/useSemanticElements: a mark of a form is no fieldset
    <div className={draftMarkStyles.mark} role="group" aria-label={fillText(TEXTS.draftOf, { form: of })}>
      <span>
        {fillText(TEXTS.draftSince, { draft: words, time: dateTime(draft.since) })}
        {!draft.stored && ` ${TEXTS.draftNotStored}`}
      </span>
      {isAsking ? (
        <>
          <span>{fillText(TEXTS.discardQuestion, { result: back })}</span>
          <Button
            size="compact-xs"
            color="red"
            variant="light"
            onClick={() => {
              setAsking(false);
              onDiscard();
            }}
          >
            {TEXTS.discardDraft}
          </Button>
          <Button size="compact-xs" variant="default" onClick={() => setAsking(false)}>
            {TEXTS.keepDraft}
          </Button>
        </>
      ) : (
        <Button
          size="compact-xs"
          variant="default"
          aria-label={fillText(TEXTS.discardDraftOf, { form: of })}
          onClick={() => setAsking(true)}
        >
          {TEXTS.discard}
        </Button>
      )}
    </div>
  );
}

/** Asks before other content replaces a draft. */

/**
 * Returns a guard, which runs an action at once without a draft and otherwise after a question, and the question.
 *
 * Args:
 *   isDraft: whether there is a draft that the action would replace.
 */
export function useReplaceDraft(isDraft: boolean): [(action: () => void) => void, ReactNode] {
  const [pending, setPending] = useState<{ readonly action: () => void } | null>(null);
  const guard = (action: () => void): void => (isDraft ? setPending({ action }) : action());
  const question =
    pending === null ? null : (
      <div className={draftMarkStyles.mark} role="alertdialog" aria-label={TEXTS.replaceTitle}>
        <span>{TEXTS.replaceHint}</span>
        <Button
          size="compact-xs"
          color="red"
          variant="light"
          onClick={() => {
            setPending(null);
            pending.action();
          }}
        >
          {TEXTS.replaceDraft}
        </Button>
        <Button size="compact-xs" variant="default" onClick={() => setPending(null)}>
          {TEXTS.keepDraft}
        </Button>
      </div>
    );
  return [guard, question];
}
