/** Asks before something else takes the place of a draft. */

import { Button } from "@mantine/core";
import { type ReactNode, useState } from "react";
import styles from "./DraftMark.module.css";

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
      <div className={styles.mark} role="alertdialog" aria-label="Replace the draft">
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
