/** How late the ticks of the last minute began, and what the machine granted to the loop. */

import { Table } from "@mantine/core";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/Verdict";
import { fixed } from "../../samples/format";
import type { SystemState } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./System.module.css";

export function Lateness({ system }: { system: SystemState | undefined }) {
  const classes = system?.lateness ?? [];
  const total = classes.reduce((sum, { ticks }) => sum + ticks, 0);
  const granted = system?.granted;
  return (
    <Card title="Lateness of the last minute">
      <div className={page.tableScroll}>
        <Table aria-label="Lateness" verticalSpacing={3}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Late by [µs]</Table.Th>
              <Table.Th className={styles.number}>Ticks</Table.Th>
              <Table.Th className={styles.number}>%</Table.Th>
              <Table.Th className={styles.barColumn}>
                <span className={styles.hidden}>Share, on a logarithmic scale</span>
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
                <Table.Td className={styles.number}>{ticks}</Table.Td>
                <Table.Td className={styles.number}>
                  {total > 0 ? fixed((100 * ticks) / total, 2) : "no tick yet"}
                </Table.Td>
                <Table.Td>
                  <div
                    className={styles.bar}
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
        <ul className={styles.granted} aria-label="Granted by the machine">
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
