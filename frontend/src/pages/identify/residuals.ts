/** A residual test in words: which test, its statistic, its level. */

import { fixed } from "../../samples/format";
import type { Correlation } from "../../wire/types";

export function residualOutcome(test: Correlation, good: string, bad: string): string {
  const { correlation, statistic, critical, level, passed } = test;
  return (
    `${passed ? good : bad}: largest of ${correlation.length} correlations ${fixed(statistic, 1)} standard ` +
    `deviations, bound ${fixed(critical, 1)} at the ${fixed(100 * level, 0)} % level for all lags together`
  );
}
