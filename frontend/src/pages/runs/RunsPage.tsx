/** Page Runs: search, view, compare and download recorded runs. */

import { useMemo } from "react";
import { useParams } from "wouter";
import { MetricChart } from "./MetricChart";
import { RunDetail } from "./RunDetail";
import { RunTable } from "./RunTable";
import { comparedIn, othersIn } from "./runAddress";

export default function RunsPage() {
  const { id, at, others, how, chart } = useParams();
  const further = useMemo(() => othersIn(others, Number(id)), [others, id]);
  const comparison = useMemo(() => comparedIn(how), [how]);
  if (chart !== undefined) return <MetricChart />;
  return id === undefined ? (
    <RunTable />
  ) : (
    <RunDetail
      key={id}
      id={Number(id)}
      at_s={at === undefined ? null : Number(at)}
      others={further.numbers}
      compared={comparison.compared}
      problem={[further.problem, comparison.problem].filter((one) => one !== "").join(". ")}
    />
  );
}
