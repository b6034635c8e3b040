/** Good or not, with icon and words, never by colour alone. */

import type { ReactNode } from "react";
import { TbAlertTriangle, TbCheck } from "react-icons/tb";
import type { Experiment } from "../wire/types";
import { Explained, type Meaning } from "./Explained";
import { LocalizedText } from "./LocalizedText";
import styles from "./Verdict.module.css";

interface VerdictProps {
  readonly good: boolean;
  /** What decides it, of the glossary. */
  readonly of?: Meaning;
  readonly children: ReactNode;
}

export function Verdict({ good, of, children }: VerdictProps) {
  const Icon = good ? TbCheck : TbAlertTriangle;
  return (
    <span className={styles.verdict} data-good={good}>
      <Icon size={16} aria-hidden="true" />
      <span>
        <Explained of={of} quiet>
          {typeof children === "string" ? <LocalizedText text={children} /> : children}
        </Explained>
      </span>
    </span>
  );
}

/** What a run came to, in the sentence of its report; only one that passed looks as if it had. */
export function Outcome({ of: { outcome, verdict } }: { of: Pick<Experiment, "outcome" | "verdict"> }) {
  const of = `outcome:${outcome}`;
  if (outcome === "neutral") {
    return (
      <Explained of={of} quiet>
        {verdict}
      </Explained>
    );
  }
  return (
    <Verdict good={outcome === "passed"} of={of}>
      {verdict}
    </Verdict>
  );
}
