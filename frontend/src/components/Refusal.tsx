/** Room kept free for the reason why a value was refused, so that nothing moves when there is one. */

import styles from "./Refusal.module.css";

export function Refusal({ text }: { text: string | null | undefined }) {
  return (
    <div className={styles.refusal} role="status" aria-label="Refusal" title={text ?? undefined}>
      {text ?? ""}
    </div>
  );
}
