/** One experiment: progress while it runs, then pass or fail per criterion, metrics, curves and downloads. */

import { useQuery } from "@tanstack/react-query";
import { Card } from "../../components/Card";
import { Downloads } from "../../components/Downloads";
import { LocalizedText } from "../../components/LocalizedText";
import { RunState } from "../../components/RunState";
import { Outcome } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { dateTime } from "../../samples/format";
import { experimentQuery, isRunning } from "../../service/queries";
import type { Experiment } from "../../wire/types";
import page from "../Page.module.css";
import { RunCharts } from "../runs/RunCharts";
import { Figures } from "./Figures";
import { RunSummary } from "./RunSummary";

export function ExperimentResult({ id }: { id: number }) {
  const { data, error } = useQuery(experimentQuery(id));
  if (data === undefined) {
    return (
      <Card title="Result">
        <p className={page.empty}>{error?.message ?? "Loading …"}</p>
      </Card>
    );
  }
  const running = isRunning(data.status);
  return (
    <>
      <Card title="Result" aside={<RunState state={data.status} reason={data.message} />}>
        <div className={page.fields}>
          <span>
            {data.title}, run {data.id}, {dateTime(data.created)}. <LocalizedText text={data.message} />
          </span>
          <RunSummary name={data.name} settings={data.settings} />
          {running ? <ExperimentProgress experiment={data} /> : <Findings experiment={data} />}
        </div>
      </Card>
      {!running && (
        <Card title="Curves">
          <div className={page.charts}>
            <RunCharts run={data.id} />
          </div>
        </Card>
      )}
    </>
  );
}

function ExperimentProgress({ experiment }: { experiment: Experiment }) {
  const task = useLive((live) => live.state?.task ?? null);
  const mine = task !== null && task.run === experiment.id && task.phase !== "evaluation";
  return <span>{mine ? "It runs; what it comes to stands here afterwards." : "computing the result …"}</span>;
}

function Findings({ experiment }: { experiment: Experiment }) {
  const { criteria, metrics, id } = experiment;
  return (
    <>
      <Outcome of={experiment} />
      <div className={page.actions}>
        <Downloads run={id} report />
      </div>
      <Figures criteria={criteria} metrics={metrics} />
    </>
  );
}
