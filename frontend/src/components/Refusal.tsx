/** Room kept free for the reason why a value was refused, so that nothing moves when there is one. */

import styles from "./Refusal.module.css";

interface RefusalProps {
  readonly text: string | null | undefined;
  /** The whole sentence, where `text` is short. */
  readonly detail?: string | undefined;
  /** Shown while nothing is refused. */
  readonly hint?: string;
}

export function Refusal({ text, detail, hint = "" }: RefusalProps) {
  const refused = text !== null && text !== undefined;
  return (
    <output
      className={styles.refusal}
      aria-label="Refusal"
      data-refused={refused}
      title={refused ? (detail ?? text) : undefined}
    >
      {refused ? text : hint}
    </output>
  );
}
