/** A small reading: what above, how much below, in a width that does not change with the digits. */

import type { ReactNode } from "react";
import { entryOf } from "../service/glossary";
import { Explained } from "./Explained";
import styles from "./Metric.module.css";

interface MetricProps {
  /** What is measured: a key of the glossary, which also says what it is called. */
  readonly of: string;
  readonly value: ReactNode;
  readonly width: string;
  /** Left out where there is little room. */
  readonly optional?: boolean;
}

export function Metric({ of, value, width, optional = false }: MetricProps) {
  return (
    <span className={styles.metric} data-optional={optional} style={{ minWidth: width }}>
      <span className={styles.label}>
        <Explained of={of}>{entryOf(of)?.term}</Explained>
      </span>
      <span className={styles.value}>{value}</span>
    </span>
  );
}
