/** A small reading: what above, how much below, in a width that does not change with the digits. */

import type { ReactNode } from "react";
import styles from "./Metric.module.css";

interface MetricProps {
  readonly label: string;
  /** What is measured, in a sentence for who does not know the label. */
  readonly meaning: string;
  readonly value: ReactNode;
  readonly width: string;
  /** Left out where there is little room. */
  readonly optional?: boolean;
}

export function Metric({ label, meaning, value, width, optional = false }: MetricProps) {
  return (
    <span className={styles.metric} title={meaning} data-optional={optional} style={{ minWidth: width }}>
      <span className={styles.label}>{label}</span>
      <span className={styles.value}>{value}</span>
    </span>
  );
}
