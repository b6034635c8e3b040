/** Identified gains and lags over S, compared with predictions from geometry, springs and motor loops. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { CurvePlot } from "../../charts/CurvePlot";
import { Card } from "../../components/Card";
import { SignalName } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed, significant } from "../../samples/format";
import { countThings, fillText } from "../../samples/texts";
import { trendQuery } from "../../service/api/identifications";
import { tuningKey } from "../../service/api/tuning";
import { HUES } from "../../theme/signals";
import type { Identification, Trend, TrendRow } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Identify.module.css";
import { TEXTS } from "./texts";

const CHANNELS = ["G_q", "G_S"] as const;
const FIGURES = ["K", "T"] as const;
const UNITS = { G_q: { K: "", T: "s" }, G_S: { K: "N·m/rad²", T: "s" } } as const;
const CURVES = { G_q: { K: "K_q", T: "T_q" }, G_S: { K: "K_S", T: "T_S" } } as const;
const HUE = { G_q: HUES.q, G_S: HUES.S } as const;

export function TrendCard({ identifications }: { identifications: readonly Identification[] }) {
  const made = identifications.filter(({ kind, estimate }) => kind === "actuator" && estimate !== null);
  const tuning = useLive((live) => tuningKey(live.state?.tuning));
  const trend = useQuery({
    ...trendQuery(made.map(({ estimate }) => estimate).join(" "), tuning),
    enabled: made.length > 0,
  });
  if (made.length === 0) return null;
  return (
    <Card title={TEXTS.trend}>
      <p className={page.lead}>{TEXTS.trendLead}</p>
      {trend.error && <p className={page.empty}>{trend.error.message}</p>}
      {trend.data === undefined && !trend.error && <p className={page.empty}>{TEXTS.predicting}</p>}
      {trend.data && <Shown trend={trend.data} />}
    </Card>
  );
}

function Shown({ trend }: { trend: Trend }) {
  return (
    <>
      {CHANNELS.map((channel) => (
        <section
          key={channel}
          className={styles.model}
          aria-label={fillText(TEXTS.channelOverS, { channel })}
        >
          <h3 className={styles.heading}>
            <SignalName name={channel} />
          </h3>
          <div className={page.halves}>
            {FIGURES.map((figure) => (
              <CurvePlot
                key={figure}
                title={fillText(TEXTS.figureOverS, { figure, channel })}
                xLabel="S [N·m/rad]"
                yLabel={UNITS[channel][figure]}
                height={160}
                summary={fillText(TEXTS.trendSummary, {
                  points: countThings(trend.rows.length, "identified point"),
                })}
                curves={[
                  {
                    label: TEXTS.predictedCurve,
                    colour: "text",
                    line: "dashed",
                    x: trend.predicted.S,
                    y: trend.predicted[CURVES[channel][figure]],
                  },
                  {
                    label: TEXTS.identifiedCurve,
                    colour: HUE[channel],
                    line: "none",
                    points: true,
                    x: trend.rows.map(({ S }) => S),
                    y: trend.rows.map((row) => row[channel][figure].identified),
                  },
                ]}
              />
            ))}
          </div>
          <div className={styles.scroll}>
            <Rows channel={channel} rows={trend.rows} />
          </div>
        </section>
      ))}
      <section className={styles.model} aria-label={TEXTS.friction}>
        <h3 className={styles.heading}>{TEXTS.friction}</h3>
        <p className={page.lead}>{fillText(TEXTS.frictionLead, { friction: trend.friction.sentence })}</p>
        {trend.friction.left_out.map((reason) => (
          <p key={reason} className={page.empty}>
            {fillText(TEXTS.frictionNotUsed, { reason })}
          </p>
        ))}
      </section>
      {trend.left_out.map((reason) => (
        <p key={reason} className={page.empty}>
          {fillText(TEXTS.leftOut, { reason })}
        </p>
      ))}
    </>
  );
}

function Rows({ channel, rows }: { channel: "G_q" | "G_S"; rows: readonly TrendRow[] }) {
  return (
    <Table
      withRowBorders={false}
      verticalSpacing={2}
      aria-label={fillText(TEXTS.againstGeometry, { channel })}
    >
      <Table.Thead>
        <Table.Tr>
          <Table.Th>{TEXTS.run}</Table.Th>
          <Table.Th className={page.number}>S [N·m/rad]</Table.Th>
          {FIGURES.map((figure) => {
            const unit = UNITS[channel][figure];
            return [
              <Table.Th key={figure} className={page.number}>
                <SignalName name={figure} /> {unit !== "" && `[${unit}]`}
              </Table.Th>,
              <Table.Th key={`${figure} predicted`} className={page.number}>
                {TEXTS.predicted}
              </Table.Th>,
              <Table.Th key={`${figure} off`} className={page.number}>
                {TEXTS.difference}
              </Table.Th>,
            ];
          })}
        </Table.Tr>
      </Table.Thead>
      <Table.Tbody>
        {rows.map((row) => (
          <Table.Tr key={row.run}>
            <Table.Td className={styles.together}>
              <Link href={`/identify/${row.run}`}>{fillText(TEXTS.runLink, { run: row.run })}</Link>
            </Table.Td>
            <Table.Td className={page.number}>{fixed(row.S, 2)}</Table.Td>
            {FIGURES.map((figure) => {
              const { identified, predicted, off_percent } = row[channel][figure];
              return [
                <Table.Td key={figure} className={page.number}>
                  {significant(identified, 4)}
                </Table.Td>,
                <Table.Td key={`${figure} predicted`} className={page.number}>
                  {significant(predicted, 4)}
                </Table.Td>,
                <Table.Td key={`${figure} off`} className={page.number}>
                  {`${off_percent > 0 ? "+" : ""}${fixed(off_percent, 1)}`}
                </Table.Td>,
              ];
            })}
          </Table.Tr>
        ))}
      </Table.Tbody>
    </Table>
  );
}
