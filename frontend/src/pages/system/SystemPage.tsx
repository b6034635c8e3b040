/** How the service, the loop and the link do, and what the signals mean. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { age, duration, fixed, kilohertz } from "../../samples/format";
import { healthQuery, sessionQuery } from "../../service/queries";
import { systemQuery } from "../../service/system";
import page from "../Page.module.css";
import { DatabaseCard } from "./DatabaseCard";
import { Facts } from "./Facts";
import { FlightRecords } from "./FlightRecords";
import { Lateness } from "./Lateness";
import { RecordingsCard } from "./RecordingsCard";
import { SafetyChain } from "./SafetyChain";
import styles from "./System.module.css";
import { TriggerCard } from "./TriggerCard";

export default function SystemPage() {
  const state = useLive((live) => live.state);
  const link = useLive((live) => live.link);
  const layout = useLive((live) => live.layout);
  const missed = useLive((live) => live.missed);
  const health = useQuery({ ...healthQuery, refetchInterval: 5000 });
  const session = useQuery(sessionQuery);
  const system = useQuery(systemQuery).data;
  const timing = state?.timing;
  return (
    <div className={page.page}>
      <h1 className={page.title}>System</h1>
      <div className={styles.grid}>
        <Facts
          title="Loop"
          facts={[
            [
              "Process",
              state && (
                <Verdict good={state.link.alive}>{state.link.alive ? "alive" : "not running"}</Verdict>
              ),
            ],
            [
              "Started",
              state && `${state.link.starts === 1 ? "once" : `${state.link.starts} times`} by this service`,
            ],
            ["Running for", state && duration(state.tick * (layout?.period_s ?? 0.001))],
            ["Period", timing && `${fixed(1000 * timing.period_s, 3)} ms`],
            ["Rate, last 5 s", timing && kilohertz(timing.rate_Hz)],
            ["Lateness, median", timing && `${fixed(timing.lateness_p50_ms, 3)} ms`],
            ["Lateness, 99th percentile", timing && `${fixed(timing.lateness_p99_ms, 3)} ms`],
            ["Deadlines missed", timing && fixed(timing.overruns, 0)],
          ]}
        />
        <Facts
          title="Service and this page"
          facts={[
            ["Version", health.data?.version],
            ["Made with", system && versions(system.versions)],
            ["Plant", state && `${state.plant.says || state.plant.name}, parameters ${state.parameters}`],
            ["Signed in as", session.data && `${session.data.name} (${session.data.role})`],
            ["Control held by", state && (state.holder?.name ?? "nobody")],
            ["Link, there and back", link.latency_ms === null ? undefined : age(link.latency_ms)],
            ["Connections lost in a row", fixed(link.failures, 0)],
            ["Samples missed by this page", fixed(missed, 0)],
            [
              "Interface",
              <a key="docs" href="./api/docs">
                /api/docs
              </a>,
            ],
            [
              "Faults",
              <Link key="developer" href="/system/developer">
                Developer page
              </Link>,
            ],
          ]}
        />
        <SafetyChain />
        <DatabaseCard system={system} />
        <RecordingsCard />
        <Lateness system={system} />
      </div>
      <TriggerCard />
      <FlightRecords />
      <Card title="Signals">
        <div className={page.tableScroll}>
          <Table aria-label="Signals" verticalSpacing={3}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Name</Table.Th>
                <Table.Th>Symbol</Table.Th>
                <Table.Th>Unit</Table.Th>
                <Table.Th>Meaning</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {layout?.fields.map((field) => (
                <Table.Tr key={field.name}>
                  <Table.Td>
                    <code>{field.name}</code>
                  </Table.Td>
                  <Table.Td>{field.symbol}</Table.Td>
                  <Table.Td>{field.unit}</Table.Td>
                  <Table.Td>{field.meaning}</Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      </Card>
    </div>
  );
}

function versions(all: Record<string, string>): string {
  return Object.entries(all)
    .filter(([name]) => name !== "Sinew")
    .map(([name, version]) => `${name} ${version}`)
    .join(", ");
}
