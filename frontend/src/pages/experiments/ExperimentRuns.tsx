/** Experiments done before. */

import { Table } from "@mantine/core";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { RunState, unevaluated } from "../../components/RunState";
import { dateTime, duration } from "../../samples/format";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";

export function ExperimentRuns({
  runs,
  selected,
}: {
  runs: readonly Run[] | undefined;
  selected: number | undefined;
}) {
  return (
    <Card title="Earlier experiments">
      {(runs === undefined || runs.length === 0) && (
        <p className={page.empty}>{runs === undefined ? "Loading …" : "No experiment yet."}</p>
      )}
      {runs !== undefined && runs.length > 0 && (
        <div className={page.tableScroll}>
          <Table aria-label="Earlier experiments" highlightOnHover>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Run</Table.Th>
                <Table.Th>Kind</Table.Th>
                <Table.Th>When</Table.Th>
                <Table.Th className={page.number}>Length</Table.Th>
                <Table.Th>Who</Table.Th>
                <Table.Th>End</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {runs.map((run) => (
                <Table.Tr key={run.id} bg={run.id === selected ? "var(--accent-soft)" : undefined}>
                  <Table.Td>
                    <Link href={`/experiments/${run.id}`}>Run {run.id}</Link>
                  </Table.Td>
                  <Table.Td>{run.title}</Table.Td>
                  <Table.Td>{dateTime(run.started)}</Table.Td>
                  <Table.Td className={page.number}>{duration(run.duration_s)}</Table.Td>
                  <Table.Td>{run.who}</Table.Td>
                  <Table.Td>
                    <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      )}
    </Card>
  );
}
