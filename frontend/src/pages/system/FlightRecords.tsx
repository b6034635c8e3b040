/** The flight records of trips, ten seconds before and five after, and of triggers, to take home. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Card } from "../../components/Card";
import { LocalizedText } from "../../components/values";
import { dateTime, fixed } from "../../samples/format";
import { flightsQuery } from "../../service/api/recordings";
import page from "../Page.module.css";
import styles from "./System.module.css";

const KINDS = { trip: "Trip", trigger: "Trigger" } as const;
const FORMATS = ["csv", "parquet", "mat", "mcap"] as const;

export function FlightRecords() {
  const flights = useQuery(flightsQuery).data ?? [];
  return (
    <Card title="Flight records">
      {flights.length === 0 ? (
        <p className={page.empty}>No trip or trigger yet.</p>
      ) : (
        <div className={page.tableScroll}>
          <Table aria-label="Flight records" verticalSpacing={3}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>When</Table.Th>
                <Table.Th>Kind</Table.Th>
                <Table.Th>What happened</Table.Th>
                <Table.Th>Who</Table.Th>
                <Table.Th>Run</Table.Th>
                <Table.Th className={styles.number}>Kept [s]</Table.Th>
                <Table.Th>Data</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {flights.map((flight) => (
                <Table.Tr key={flight.id}>
                  <Table.Td>
                    <a href={`#/flights/${flight.id}`}>{dateTime(flight.at)}</a>
                  </Table.Td>
                  <Table.Td>{KINDS[flight.kind]}</Table.Td>
                  <Table.Td>
                    <LocalizedText text={flight.text} />
                  </Table.Td>
                  <Table.Td>{flight.who}</Table.Td>
                  <Table.Td>
                    {flight.run === null ? (
                      "none was recorded"
                    ) : (
                      <a href={`#/runs/${flight.run}`}>Run {flight.run}</a>
                    )}
                  </Table.Td>
                  <Table.Td className={styles.number}>
                    −{fixed(flight.before_s, decimals(flight.before_s))} to{" "}
                    {fixed(flight.after_s, decimals(flight.after_s))}
                  </Table.Td>
                  <Table.Td>
                    <span className={styles.links}>
                      {FORMATS.map((format) => (
                        <a key={format} href={`./api/flights/${flight.id}/data.${format}`} download>
                          {format.toUpperCase()}
                        </a>
                      ))}
                    </span>
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

/** One decimal where it says it all; samples are a thousandth of a second. */
function decimals(seconds: number): number {
  return Math.abs(seconds * 10 - Math.round(seconds * 10)) < 1e-6 ? 1 : 3;
}
