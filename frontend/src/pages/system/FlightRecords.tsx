/** Card with the flight records of trips and triggers, for download. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Card } from "../../components/Card";
import { LocalizedText } from "../../components/values";
import { dateTime, fixed } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { flightsQuery } from "../../service/api/recordings";
import page from "../Page.module.css";
import styles from "./System.module.css";
import { TEXTS } from "./texts";

const KINDS = { trip: TEXTS.trip, trigger: TEXTS.triggered } as const;
const FORMATS = ["csv", "parquet", "mat", "mcap"] as const;

export function FlightRecords() {
  const flights = useQuery(flightsQuery).data ?? [];
  return (
    <Card title={TEXTS.flights}>
      {flights.length === 0 ? (
        <p className={page.empty}>{TEXTS.noFlights}</p>
      ) : (
        <div className={page.tableScroll}>
          <Table aria-label={TEXTS.flights} verticalSpacing={3}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{TEXTS.columnTime}</Table.Th>
                <Table.Th>{TEXTS.columnKind}</Table.Th>
                <Table.Th>{TEXTS.columnEvent}</Table.Th>
                <Table.Th>{TEXTS.columnPerson}</Table.Th>
                <Table.Th>{TEXTS.columnRun}</Table.Th>
                <Table.Th className={styles.number}>{TEXTS.columnRange}</Table.Th>
                <Table.Th>{TEXTS.columnData}</Table.Th>
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
                      TEXTS.noRun
                    ) : (
                      <a href={`#/runs/${flight.run}`}>{fillText(TEXTS.run, { run: flight.run })}</a>
                    )}
                  </Table.Td>
                  <Table.Td className={styles.number}>
                    {fillText(TEXTS.range, {
                      before: fixed(flight.before_s, decimals(flight.before_s)),
                      after: fixed(flight.after_s, decimals(flight.after_s)),
                    })}
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

/** Returns 1 if one decimal is exact, else 3, because samples are 1 ms apart. */
function decimals(seconds: number): number {
  return Math.abs(seconds * 10 - Math.round(seconds * 10)) < 1e-6 ? 1 : 3;
}
