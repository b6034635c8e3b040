import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { useLive } from "../../live/react";
import { age, bytes, dateTime, duration, fixed, kilohertz } from "../../samples/format";
import { healthQuery, sessionQuery } from "../../service/api/session";
import { systemQuery, useBackupDatabase, useCheckDatabase } from "../../service/api/system";
import { entryOf } from "../../service/glossary";
import type { SystemState } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { Facts } from "./Facts";
import { FlightRecords } from "./FlightRecords";
import { RecordingsCard } from "./RecordingsCard";
import systemStyles from "./System.module.css";
import { TriggerCard } from "./TriggerCard";

/** Disk and database: how they do, a check of all of it, and copies. */

/** A day at the bench takes about 2 GB. */
const LITTLE_BYTES = 2e9;

export function DatabaseCard({ system }: { system: SystemState | undefined }) {
  const backup = useBackupDatabase();
  const check = useCheckDatabase();
  const database = system?.database;
  const newest = system?.backups[0];
  const free = database?.disk_free_bytes ?? 0;
  return (
    <Facts
      title="Disk and database"
      facts={[
        [
          "Database",
          database && `${database.kind}, ${bytes(database.size_bytes)}, schema ${database.schema_revision}`,
        ],
        ["Free on the disk", database && <Verdict good={free >= LITTLE_BYTES}>{bytes(free)}</Verdict>],
        [
          "Last backup",
          newest ? `${dateTime(newest.at)}, ${bytes(newest.size_bytes)}, ${newest.name}` : "none yet",
        ],
        ["Restore", "stop the service, then: sinew db restore FILE"],
      ]}
    >
      <div className={systemStyles.actions}>
        <OperatorsOnly>
          <Button variant="default" loading={backup.isPending} onClick={() => backup.mutate()}>
            Back up now
          </Button>
          <Button variant="default" loading={check.isPending} onClick={() => check.mutate()}>
            Check the database
          </Button>
        </OperatorsOnly>
        {check.data && (
          <Verdict good={check.data.length === 0}>
            {check.data.length === 0 ? "the database is whole" : check.data.join("; ")}
          </Verdict>
        )}
        <Refusal error={backup.error ?? check.error} />
      </div>
    </Facts>
  );
}

/** The safety chain in order, each link as it stands now; each watches the one before it. */

export function SafetyChain() {
  const chain = useLive((live) => live.state?.chain);
  return (
    <Facts
      title="Safety chain"
      facts={(chain ?? []).map((link) => [
        entryOf(`chain:${link.name}`)?.term ?? link.name,
        <Verdict key={link.name} good={link.good} of={`chain:${link.name}`}>
          {link.says}
          {link.silent_s !== null && `, ${fixed(link.silent_s, 1)} s ago`}
        </Verdict>,
      ])}
    />
  );
}

/** How late the ticks of the last minute began, and what the machine granted to the loop. */

export function Lateness({ system }: { system: SystemState | undefined }) {
  const classes = system?.lateness ?? [];
  const total = classes.reduce((sum, { ticks }) => sum + ticks, 0);
  const granted = system?.granted;
  return (
    <Card title="Lateness of the last minute">
      <div className={pageStyles.tableScroll}>
        <Table aria-label="Lateness" verticalSpacing={3}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Late by [µs]</Table.Th>
              <Table.Th className={systemStyles.number}>Ticks</Table.Th>
              <Table.Th className={systemStyles.number}>%</Table.Th>
              <Table.Th className={systemStyles.barColumn}>
                <span className={systemStyles.hidden}>Share, on a logarithmic scale</span>
              </Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {classes.map(({ from_us, to_us, ticks }) => (
              <Table.Tr key={from_us}>
                <Table.Td>
                  {to_us === null
                    ? `over ${fixed(from_us, 0)}`
                    : `${fixed(from_us, 0)} to ${fixed(to_us, 0)}`}
                </Table.Td>
                <Table.Td className={systemStyles.number}>{ticks}</Table.Td>
                <Table.Td className={systemStyles.number}>
                  {total > 0 ? fixed((100 * ticks) / total, 2) : "no tick yet"}
                </Table.Td>
                <Table.Td>
                  <div
                    className={systemStyles.bar}
                    style={{ width: `${share(ticks, total)}%` }}
                    aria-hidden="true"
                  />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
      {granted && (
        <ul className={systemStyles.granted} aria-label="Granted by the machine">
          <li>
            <Verdict good={granted.priority > 0}>
              {granted.priority > 0 ? `FIFO priority ${granted.priority}` : "ordinary scheduling"}
            </Verdict>
          </li>
          <li>
            <Verdict good={granted.memory_locked}>
              {granted.memory_locked ? "memory locked" : "memory not locked"}
            </Verdict>
          </li>
          <li>
            <Verdict good={granted.timer_slack_ns <= 1}>timer slack {granted.timer_slack_ns} ns</Verdict>
          </li>
          {granted.refusals.map((refusal) => (
            <li key={refusal}>{refusal}</li>
          ))}
        </ul>
      )}
    </Card>
  );
}

/** One tick in a million still shows. */
function share(ticks: number, total: number): number {
  return ticks === 0 ? 0 : (100 * Math.log10(1 + ticks)) / Math.log10(1 + total);
}

/** How the service, the loop and the link do, and what the signals mean. */

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
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>System</h1>
      <div className={systemStyles.grid}>
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
          title="Service and this pageStyles"
          facts={[
            ["Version", health.data?.version],
            ["Made with", system && versions(system.versions)],
            ["Plant", state && `${state.plant.says || state.plant.name}, parameters ${state.parameters}`],
            ["Signed in as", session.data && `${session.data.name} (${session.data.role})`],
            ["Control held by", state && (state.holder?.name ?? "nobody")],
            ["Link, there and back", link.latency_ms === null ? undefined : age(link.latency_ms)],
            ["Connections lost in a row", fixed(link.failures, 0)],
            ["Samples missed by this pageStyles", fixed(missed, 0)],
            [
              "Interface",
              <a key="docs" href="./api/docs">
                /api/docs
              </a>,
            ],
            [
              "Faults",
              <Link key="developer" href="/system/developer">
                Developer pageStyles
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
        <div className={pageStyles.tableScroll}>
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
