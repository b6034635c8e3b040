/** Good or not, with icon and words, never by colour alone. */

import { IconAlertTriangle, IconCheck } from "@tabler/icons-react";
import type { ReactNode } from "react";
import styles from "./Verdict.module.css";

export function Verdict({ good, children }: { good: boolean; children: ReactNode }) {
  const Icon = good ? IconCheck : IconAlertTriangle;
  return (
    <span className={styles.verdict} data-good={good}>
      <Icon size={16} aria-hidden="true" />
      <span>{children}</span>
    </span>
  );
}
