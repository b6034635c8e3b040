/** Good or not, with icon and words, never by colour alone. */

import type { ReactNode } from "react";
import { TbAlertTriangle, TbCheck } from "react-icons/tb";
import type { Experiment } from "../wire/types";
import { Told } from "./Told";
import styles from "./Verdict.module.css";

export function Verdict({ good, children }: { good: boolean; children: ReactNode }) {
  const Icon = good ? TbCheck : TbAlertTriangle;
  return (
    <span className={styles.verdict} data-good={good}>
      <Icon size={16} aria-hidden="true" />
      <span>{typeof children === "string" ? <Told text={children} /> : children}</span>
    </span>
  );
}

/** What a run came to, in the sentence of its report; only one that passed looks as if it had. */
export function Outcome({ of: { outcome, verdict } }: { of: Pick<Experiment, "outcome" | "verdict"> }) {
  if (outcome === "neutral") return <span>{verdict}</span>;
  return <Verdict good={outcome === "passed"}>{verdict}</Verdict>;
}
