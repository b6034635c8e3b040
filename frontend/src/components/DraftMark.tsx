/** Says that a form holds a draft, since when, and offers to discard it. Discarding asks first. */

import { Button } from "@mantine/core";
import { useState } from "react";
import { dateTime } from "../samples/format";
import type { Draft } from "../service/useDraft";
import styles from "./DraftMark.module.css";

interface DraftMarkProps {
  readonly draft: Pick<Draft<unknown>, "since" | "stored">;
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
    <div className={styles.mark} role="group" aria-label={`Draft of the ${of}`}>
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
