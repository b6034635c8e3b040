/** One experiment: progress while it runs, then pass or fail per criterion, metrics, curves and downloads. */

import { Progress, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Card } from "../../components/Card";
import { Downloads } from "../../components/Downloads";
import { RunState } from "../../components/RunState";
import { taskProgress } from "../../components/status";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { dateTime, duration, significant } from "../../samples/format";
import { experimentQuery, isRunning } from "../../service/queries";
import type { Experiment } from "../../wire/types";
import page from "../Page.module.css";
import { RunCharts } from "../runs/RunCharts";

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
            {data.name.replaceAll("_", " ")}, run {data.id}, {dateTime(data.created)}. {data.message}
          </span>
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
  const mine = task !== null && task.run === experiment.id;
  return (
    <div className={page.fields}>
      <Progress.Root size={10}>
        <Progress.Section
          value={100 * (mine ? taskProgress(task) : experiment.progress)}
          aria-label="Experiment progress"
        />
      </Progress.Root>
      <span>
        {mine
          ? `${task.phase.replaceAll("_", " ")}: ${duration(task.elapsed_s)} of ${duration(task.duration_s)}`
          : "computing the result …"}
      </span>
    </div>
  );
}

function Findings({ experiment }: { experiment: Experiment }) {
  const { criteria, metrics, id } = experiment;
  const failed = criteria.filter((criterion) => criterion.passed === false).length;
  return (
    <>
      {criteria.length > 0 && (
        <Verdict good={failed === 0}>
          {failed === 0
            ? `All ${criteria.length} criteria passed.`
            : `${failed} of ${criteria.length} criteria failed.`}
        </Verdict>
      )}
      <div className={page.actions}>
        <Downloads run={id} report />
      </div>
      <div className={page.halves}>
        {criteria.length > 0 && (
          <Table aria-label="Criteria" verticalSpacing={4}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Criterion</Table.Th>
                <Table.Th className={page.number}>Value</Table.Th>
                <Table.Th>Bound</Table.Th>
                <Table.Th>Result</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {criteria.map((criterion) => (
                <Table.Tr key={criterion.name}>
                  <Table.Td>{criterion.label}</Table.Td>
                  <Table.Td className={page.number}>{significant(criterion.value, 3)}</Table.Td>
                  <Table.Td style={{ whiteSpace: "nowrap" }}>
                    {criterion.relation} {criterion.bound} {criterion.unit}
                  </Table.Td>
                  <Table.Td>
                    <Outcome passed={criterion.passed} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        )}
        {metrics.length > 0 && (
          <Table aria-label="Metrics" verticalSpacing={4}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Metric</Table.Th>
                <Table.Th className={page.number}>Value</Table.Th>
                <Table.Th>Unit</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {metrics.map((metric) => (
                <Table.Tr key={metric.name}>
                  <Table.Td>{metric.label}</Table.Td>
                  <Table.Td className={page.number}>{significant(metric.value, 4)}</Table.Td>
                  <Table.Td>{metric.unit}</Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        )}
      </div>
    </>
  );
}

function Outcome({ passed }: { passed: boolean | null }) {
  if (passed === null) return <span className={page.dim}>no figure</span>;
  return <Verdict good={passed}>{passed ? "pass" : "fail"}</Verdict>;
}
