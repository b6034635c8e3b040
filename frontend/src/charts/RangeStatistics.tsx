/** Statistics of the visible range, or between the cursors, as long as they are shown. */

import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { Panel } from "../theme/signals";
import { StatisticsTable } from "./StatisticsTable";
import type { StoredData } from "./stored";
import { useStatistics } from "./useStatistics";

interface RangeStatisticsProps {
  readonly panels: readonly Panel[];
  readonly hidden: ReadonlySet<string>;
  readonly names: readonly string[];
  readonly stored: StoredData | null;
  range(): Stretch;
  table(): SampleTable;
  timeText(time_s: number): string;
}

export function RangeStatistics(props: RangeStatisticsProps) {
  const { panels, hidden, names, stored, range, table, timeText } = props;
  const shown = useStatistics({ names, range, table }, stored);
  return <StatisticsTable panels={panels} hidden={hidden} shown={shown} timeText={timeText} />;
}
