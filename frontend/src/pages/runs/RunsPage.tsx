/** Everything that was recorded: search, look, compare, take home. */

import { useMemo } from "react";
import { useParams } from "wouter";
import { MetricChart } from "./MetricChart";
import { RunDetail } from "./RunDetail";
import { RunTable } from "./RunTable";
import { comparedIn, othersIn } from "./runAddress";

export default function RunsPage() {
  const { id, at, others, how, chart } = useParams();
  const beside = useMemo(() => othersIn(others, Number(id)), [others, id]);
  const told = useMemo(() => comparedIn(how), [how]);
  if (chart !== undefined) return <MetricChart />;
  return id === undefined ? (
    <RunTable />
  ) : (
    <RunDetail
      key={id}
      id={Number(id)}
      at_s={at === undefined ? null : Number(at)}
      others={beside.numbers}
      compared={told.compared}
      problem={[beside.problem, told.problem].filter((one) => one !== "").join(". ")}
    />
  );
}
